#include "firmware/hal/linux/radio_key_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <stdexcept>

namespace ivfm {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

class RadioKeyFile : public testing::Test {
 protected:
  RadioKeyFile() { fs::create_directories(folder_); }
  ~RadioKeyFile() override { fs::remove_all(folder_); }
  std::string path() const { return folder_ / "robot.key"; }
  std::string failure() const {
    try {
      read_radio_keys(path());
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "";
  }
  fs::path folder_ =
      fs::temp_directory_path() / ("radio_key_file." + std::to_string(std::random_device()()));
};

std::string parse_failure(const std::string& text) {
  try {
    parse_radio_keys(text, "k");
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST_F(RadioKeyFile, HoldsKeysForItsOwnerOnly) {
  const RadioKeys keys{{1, draw_radio_key()}, {65535, draw_radio_key()}};
  write_radio_keys(path(), keys);
  EXPECT_EQ(read_radio_keys(path()), keys);
  EXPECT_EQ(fs::status(path()).permissions(), fs::perms(0600));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), {}), 1);
}

TEST_F(RadioKeyFile, IsRefusedWhenOthersHaveAccess) {
  write_radio_keys(path(), {{1, draw_radio_key()}});
  for (const mode_t mode : {0640, 0604, 0620, 0602, 0610}) {
    ASSERT_EQ(::chmod(path().c_str(), mode), 0);
    EXPECT_THAT(failure(), HasSubstr("others have access to the radio keys " + path() +
                                     "; make it yours alone: chmod 600 "));
  }
  ASSERT_EQ(::chmod(path().c_str(), 0400), 0);
  EXPECT_EQ(failure(), "");
}

TEST_F(RadioKeyFile, SaysWhatIsWrong) {
  EXPECT_THAT(failure(), HasSubstr("No such file"));
  fs::create_directory(path());
  EXPECT_THAT(failure(), HasSubstr("are no file"));
}

TEST(RadioKeys, LinesAreNumbersAndHexadecimalKeys) {
  const std::string hex = "000102030405060708090A0b0c0d0e0f101112131415161718191a1b1c1d1e1f";
  const RadioKeys keys = parse_radio_keys("# two\n\n7 " + hex + "\r\n9 " + hex, "k");
  ASSERT_EQ(keys.size(), 2u);
  EXPECT_EQ(keys.at(7)[10], 10);
  for (const std::string& line :
       {"0 " + hex, "65536 " + hex, "-1 " + hex, hex, "7" + hex, "7  " + hex, "7 " + hex + "0",
        "7 " + hex.substr(1), "7 g" + hex.substr(1), std::string("7"), "8 " + hex}) {
    EXPECT_THAT(parse_failure("8 " + hex + "\n" + line), HasSubstr("k:2: ")) << line;
  }
  EXPECT_THAT(parse_failure("# none\n"), HasSubstr("holds no radio key"));
}

}  // namespace
}  // namespace ivfm

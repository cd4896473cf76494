#include "host/can_analysis/can_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "host/map_server/scratch_folder.h"

namespace ivfm::host {
namespace {

using testing::HasSubstr;

TEST(CanLog, ReadsWhatCandumpWrites) {
  const auto frame = parse_candump("(1436509052.249713) can0 123#AAbb");
  ASSERT_TRUE(frame.has_value());
  EXPECT_NEAR(frame->time_s, 1436509052.249713, 1e-6);
  EXPECT_EQ(frame->bus, "can0");
  EXPECT_EQ(frame->id, 0x123u);
  EXPECT_EQ(frame->size, 2);
  EXPECT_EQ(frame->data[1], 0xbb);
  EXPECT_FALSE(frame->extended);
  EXPECT_TRUE(parse_candump("(0.5) vcan0 00000123#")->extended);
  EXPECT_TRUE(parse_candump("(0.5) vcan0 123#R")->remote);
  EXPECT_TRUE(parse_candump("(0.5) vcan0 123#R8\r").has_value());
  EXPECT_EQ(parse_candump("(0.5) vcan0 123#AA R")->size, 1);  // candump -x marks the direction
}

TEST(CanLog, RefusesEverythingElse) {
  for (const char* line :
       {"", "x", "(1.5)", "(1.5) can0", "(1.5) can0 123", "1.5 can0 123#", "(1.5) can0 800#",
        "(1.5) can0 123#A", "(1.5) can0 123#GG", "(1.5) can0 123#001122334455667788",
        "(1.5) can0 123##1AA", "(x.5) can0 123#", "(1.) can0 123#", "(1.5) can0 FFFFFFFF#"}) {
    EXPECT_FALSE(parse_candump(line).has_value()) << line;
  }
}

TEST(CanLog, CountsBadLinesAndGoesOn) {
  const ScratchFolder folder;
  std::ofstream(folder / "can.log") << "(1.5) can0 123#AA\nnonsense\n\n(2.5) can0 124#\n(2.6) can";
  int frames = 0;
  const auto counters = read_can_log(folder / "can.log", [&](const CanLogFrame&) { ++frames; });
  EXPECT_EQ(frames, 2);
  EXPECT_EQ(counters.malformed, 2u);  // the last line is half-written
}

TEST(CanLog, SaysWhatIsWrongWithAFile) {
  const ScratchFolder folder;
  const auto failure = [](const std::filesystem::path& file) {
    try {
      read_can_log(file, [](const CanLogFrame&) {});
    } catch (const std::runtime_error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_THAT(failure(folder / "none.log"), HasSubstr("cannot be read"));
  EXPECT_THAT(failure(folder.path()), HasSubstr("cannot be read"));
  std::ofstream(folder / "other.log") << "a\nb\n";
  EXPECT_THAT(failure(folder / "other.log"), HasSubstr("no line of candump"));
}

}  // namespace
}  // namespace ivfm::host

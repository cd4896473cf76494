#include "host/evaluation/episode_store.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace ivfm::host {
namespace {

EpisodeRecord record_number(int episode) {
  EpisodeRecord r;
  r.episode = episode;
  r.decisions = 17;
  r.busy_s = 0.1;
  r.metrics.seed = 0xffff'ffff'ffff'fffeu;
  r.metrics.found = true;
  r.metrics.rer = 1.0 / 3;
  r.metrics.steps = 12 + episode;
  r.metrics.distance_m = 1e-300;
  r.metrics.milestone_m = {2.5, std::nullopt, 1e22, std::nullopt};
  return r;
}

class EpisodeStoreFile : public testing::Test {
 protected:
  ~EpisodeStoreFile() override { std::filesystem::remove(path_); }
  std::filesystem::path path_ =
      std::filesystem::temp_directory_path() /
      ("episode_store_test." +
       std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
};

TEST(EpisodeLine, ReadsBackTheSameBits) {
  const EpisodeRecord record = record_number(3);
  const auto [key, read] = from_line(to_line("1x qnet seed=1", record));
  EXPECT_EQ(key, "1x qnet seed=1");
  EXPECT_EQ(read, record);
}

TEST(EpisodeLine, RefusesWhatIsNone) {
  const std::string line = to_line("key", record_number(0));
  EXPECT_THROW(from_line(line + ","), std::invalid_argument);
  EXPECT_THROW(from_line(line.substr(0, 30)), std::invalid_argument);
  EXPECT_THROW(from_line("key,one,2"), std::invalid_argument);
  EXPECT_THROW(from_line(""), std::invalid_argument);
}

TEST_F(EpisodeStoreFile, GoesOnAfterALineThatWasCutOff) {
  {
    EpisodeStore store(path_);
    for (int i = 0; i < 3; ++i) store.add(to_line("a", record_number(i)));
    store.add(to_line("b", record_number(0)));
  }
  // The last line ends in the middle of its last number: it must not count.
  std::filesystem::resize_file(path_, std::filesystem::file_size(path_) - 1);
  {
    EpisodeStore store(path_);
    EXPECT_EQ(store.count("a", 200), 3);
    EXPECT_EQ(store.count("a", 2), 2);
    EXPECT_EQ(store.count("b", 200), 0);
    store.add(to_line("b", record_number(0)));
  }
  const EpisodeStore store(path_);
  EXPECT_EQ(store.count("b", 200), 1);
  EXPECT_EQ(store.lines().size(), 4u);
  EXPECT_EQ(store.episodes("a").at(2), record_number(2));
}

TEST_F(EpisodeStoreFile, SaysWhatCannotBeWritten) {
  EXPECT_THROW(EpisodeStore("/proc/no/such/file"), std::exception);
}

}  // namespace
}  // namespace ivfm::host

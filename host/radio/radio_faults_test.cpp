#include "host/radio/radio_faults.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <random>
#include <stdexcept>
#include <string>

namespace ivfm::host {
namespace {

TEST(RadioFaults, ReadsEveryFault) {
  RadioFaults faults;
  add_radio_faults(
      faults,
      "drop=0.3,duplicate=0.1,reorder=0.2,corrupt=0.01,truncate=1,delay=20ms,jitter=1.5s,"
      "rate=10000,partition@30s+60s,partition@200s");
  EXPECT_DOUBLE_EQ(faults.drop, 0.3);
  EXPECT_DOUBLE_EQ(faults.duplicate, 0.1);
  EXPECT_DOUBLE_EQ(faults.reorder, 0.2);
  EXPECT_DOUBLE_EQ(faults.corrupt, 0.01);
  EXPECT_DOUBLE_EQ(faults.truncate, 1);
  EXPECT_EQ(faults.delay_us, 20'000u);
  EXPECT_EQ(faults.jitter_us, 1'500'000u);
  EXPECT_EQ(faults.bytes_per_second, 10'000u);
  ASSERT_EQ(faults.partitions.size(), 2u);
  EXPECT_EQ(faults.partitions[0].begin_us, 30'000'000u);
  EXPECT_EQ(faults.partitions[0].end_us, 90'000'000u);
  EXPECT_EQ(faults.partitions[1].end_us, std::numeric_limits<TimeUs>::max());
}

TEST(RadioFaults, SaysWhatIsWrongAndWhatWouldBeRight) {
  for (const char* text :
       {"", "drop", "drop=", "drop=1.1", "drop=-1", "drop=0.1x", "drop=0.1,", "delay=20", "rate=0",
        "jitter=1m", "partition", "partition@", "partition@1s+", "partition=1s", "dorp=0.1"}) {
    try {
      RadioFaults faults;
      add_radio_faults(faults, text);
      ADD_FAILURE() << text;
    } catch (const std::invalid_argument& error) {
      EXPECT_THAT(error.what(), testing::HasSubstr("partition@30s+60s")) << text;
    }
  }
}

TEST(RadioFaults, RandomTextNeverCrashes) {
  std::mt19937 random(3);
  const std::string alphabet = "drop=,delayptn@+.0123456789sm";
  for (int i = 0; i < 5000; ++i) {
    std::string text = random() % 2 ? "drop=" : "partition@";
    for (std::size_t n = random() % 12; n > 0; --n) text += alphabet[random() % alphabet.size()];
    try {
      RadioFaults faults;
      add_radio_faults(faults, text);
    } catch (const std::invalid_argument&) {
    }
  }
}

}  // namespace
}  // namespace ivfm::host

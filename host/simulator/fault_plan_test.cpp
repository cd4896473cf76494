#include "host/simulator/fault_plan.h"

#include <gtest/gtest.h>

#include <random>
#include <stdexcept>

namespace ivfm::host {
namespace {

TEST(FaultPlan, ReadsAMomentAndADuration) {
  const Fault fault = parse_fault("lidar-silence@12s+3s");
  EXPECT_EQ(fault.kind, FaultKind::kLidarSilence);
  EXPECT_FALSE(fault.is_active(1, 11'999'999));
  EXPECT_TRUE(fault.is_active(1, 12'000'000));
  EXPECT_TRUE(fault.is_active(2, 14'999'999));
  EXPECT_FALSE(fault.is_active(1, 15'000'000));
}

TEST(FaultPlan, WithoutADurationItLastsToTheEnd) {
  const Fault fault = parse_fault("drive-fault#2@1.5s");
  EXPECT_EQ(fault.kind, FaultKind::kDriveFault);
  EXPECT_TRUE(fault.is_active(2, 1'500'000));
  EXPECT_TRUE(fault.is_active(2, 1'000'000'000'000));
  EXPECT_FALSE(fault.is_active(1, 1'500'000));
}

TEST(FaultPlan, ReadsMillisecondsAndEveryName) {
  EXPECT_EQ(parse_fault("drive-silence@250ms+50ms").end_us, 300'000u);
  EXPECT_EQ(parse_fault("lidar-garbage@0s").kind, FaultKind::kLidarGarbage);
}

TEST(FaultPlan, ReadsAProbability) {
  const Fault fault = parse_fault("can-drop=0.1");
  EXPECT_EQ(fault.kind, FaultKind::kCanDrop);
  EXPECT_DOUBLE_EQ(fault.probability, 0.1);
  EXPECT_TRUE(fault.is_active(3, 0));
}

TEST(FaultPlan, SaysWhatIsWrongAndWhatWouldBeRight) {
  for (const char* text :
       {"", "lidar", "lidar-silence", "lidar-silence@", "lidar-silence@12", "lidar-silence@12s+",
        "lidar-silence@12s3s", "lidar-silence@-1s", "lidar-silence@nans", "lidar-silence#0@1s",
        "lidar-silence@1e99s", "can-drop", "can-drop=2", "can-drop=0.1x", "can-drop@1s"}) {
    try {
      parse_fault(text);
      ADD_FAILURE() << text;
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(std::string(error.what()).find("lidar-silence@12s+3s"), std::string::npos);
    }
  }
}

TEST(FaultPlan, RandomTextNeverCrashes) {
  std::mt19937 random(3);
  const std::string alphabet = "lidar-silence@#=+.0123456789smcande";
  for (int i = 0; i < 5000; ++i) {
    std::string text = random() % 2 ? "lidar-silence" : "can-drop";
    for (std::size_t n = random() % 12; n > 0; --n) text += alphabet[random() % alphabet.size()];
    try {
      parse_fault(text);
    } catch (const std::invalid_argument&) {
    }
  }
}

}  // namespace
}  // namespace ivfm::host

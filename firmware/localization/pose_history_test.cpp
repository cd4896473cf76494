#include "firmware/localization/pose_history.h"

#include <gtest/gtest.h>

#include <memory>

namespace ivfm {
namespace {

TEST(PoseHistory, InterpolatesBetweenItsPosesAndHoldsAtTheEnds) {
  PoseHistory history;
  history.add(1000, {{0, 0}, BinaryAngle::from_degrees(350)});
  history.add(2000, {{1000, -2000}, BinaryAngle::from_degrees(10)});
  const Pose middle = history.at(1500);
  EXPECT_EQ(middle.position, (Point{500, -1000}));
  EXPECT_NEAR(middle.heading.degrees(), 0.0, 0.02) << "the short way over north";
  EXPECT_EQ(history.at(0).position, (Point{0, 0}));
  EXPECT_EQ(history.at(9999).position, (Point{1000, -2000}));
}

TEST(PoseHistory, ForgetsTheOldestAndIgnoresTimeGoingBack) {
  PoseHistory history;
  for (std::int32_t i = 0; i < 200; ++i) {
    history.add(static_cast<TimeUs>(i) * 10, {{i, 0}, BinaryAngle()});
  }
  history.add(5, {{777, 0}, BinaryAngle()});
  EXPECT_EQ(history.at(1990).position.x_um, 199);
  EXPECT_EQ(history.at(0).position.x_um, 200 - 64);
}

TEST(Deskew, AStandingRobotsScanStaysAsItIs) {
  PoseHistory history;
  history.add(0, {{500, 600}, BinaryAngle::from_degrees(30)});
  auto scan = std::make_unique<Scan>(), out = std::make_unique<Scan>();
  scan->push({BinaryAngle::from_degrees(45), 2345, Echo::kHit, 20});
  scan->push({BinaryAngle::from_degrees(46), 0, Echo::kNothing, 0});
  deskew(*scan, 1000, 2000, history, *out);
  ASSERT_EQ(out->size, 2u);
  EXPECT_EQ(out->storage[0], scan->storage[0]);
  EXPECT_EQ(out->storage[1], scan->storage[1]);
}

TEST(Deskew, ATurningRobotsWallIsStraightAgain) {
  // Half a turn a second to the left during a sweep of 0.2 s: 36 degrees.
  PoseHistory history;
  history.add(0, {{0, 0}, BinaryAngle::from_degrees(0)});
  history.add(200'000, {{0, 0}, BinaryAngle::from_degrees(36)});
  auto scan = std::make_unique<Scan>(), out = std::make_unique<Scan>();
  scan->push({BinaryAngle::from_degrees(90), 1000, Echo::kHit, 20});   // first: along +y
  scan->push({BinaryAngle::from_degrees(-36), 1000, Echo::kHit, 20});  // last: along +x
  deskew(*scan, 0, 200'000, history, *out);
  EXPECT_NEAR(out->storage[0].bearing.degrees(), 90 - 36, 0.02);
  EXPECT_NEAR(out->storage[1].bearing.degrees(), -36, 0.02);
}

TEST(Deskew, ADrivingRobotsEarlyBeamsAreSeenFromItsLastPose) {
  PoseHistory history;
  history.add(0, {{0, 0}, BinaryAngle()});
  history.add(200'000, {{300'000, 0}, BinaryAngle()});
  auto scan = std::make_unique<Scan>(), out = std::make_unique<Scan>();
  scan->push({BinaryAngle::from_degrees(90), 400, Echo::kHit, 20});  // the point (0, 0.4) m
  scan->push({BinaryAngle::from_degrees(0), 1000, Echo::kHit, 20});
  deskew(*scan, 0, 200'000, history, *out);
  EXPECT_EQ(out->storage[0].range_mm, 500) << "3-4-5 triangle";
  EXPECT_NEAR(out->storage[0].bearing.degrees(), 180 - 53.13, 0.05);
  EXPECT_EQ(out->storage[1].range_mm, 1000);
}

}  // namespace
}  // namespace ivfm

#include "host/simulator/robot_body.h"

#include <gtest/gtest.h>

#include <cmath>

namespace ivfm::host {
namespace {

// 10 m x 10 m around the origin, empty, cells of 0.1 m.
World empty_world() {
  return {
      "empty", 100'000, 100, 100, {-5'000'000, -5'000'000}, std::vector<std::uint8_t>(10'000, 0)};
}

// Rolls in steps of 1 mm or less.
void drive(RobotBody& body, double left_m, double right_m, const World& world,
           std::span<const TruePose> others = {}) {
  const int steps =
      static_cast<int>(std::ceil(std::max(std::abs(left_m), std::abs(right_m)) / 1e-3));
  for (int i = 0; i < steps; ++i) body.roll(left_m / steps, right_m / steps, world, others);
}

TEST(RobotBody, DrivesStraight) {
  RobotBody body({}, {0, 0, M_PI / 2}, {}, 1);
  drive(body, 2, 2, empty_world());
  EXPECT_NEAR(body.pose().x_m, 0, 1e-9);
  EXPECT_NEAR(body.pose().y_m, 2, 1e-9);
  EXPECT_NEAR(body.travelled_m(), 2, 1e-9);
  EXPECT_EQ(body.collisions(), 0);
}

TEST(RobotBody, TurnsOnTheSpot) {
  RobotBody body({}, {}, {}, 1);
  const double quarter = 0.160 * M_PI / 4;  // half the wheel base times a quarter turn
  drive(body, -quarter, quarter, empty_world());
  EXPECT_NEAR(body.pose().heading_rad, M_PI / 2, 1e-9);
  EXPECT_NEAR(std::hypot(body.pose().x_m, body.pose().y_m), 0, 1e-9);
}

TEST(RobotBody, DrivesAnArcExactly) {
  // Left wheel on a circle of 0.92 m, right wheel on 1.08 m: the middle on 1 m, a quarter turn.
  RobotBody body({}, {}, {}, 1);
  body.roll(0.92 * M_PI / 2, 1.08 * M_PI / 2, empty_world(), {});
  EXPECT_NEAR(body.pose().x_m, 1, 1e-9);
  EXPECT_NEAR(body.pose().y_m, 1, 1e-9);
  EXPECT_NEAR(body.pose().heading_rad, M_PI / 2, 1e-9);
}

TEST(RobotBody, StopsAtTheWallCountsOneCollisionAndCanBackOff) {
  RobotBody body({}, {}, {}, 1);
  drive(body, 8, 8, empty_world());
  EXPECT_NEAR(body.pose().x_m, 5 - 0.105, 1.1e-3);
  EXPECT_EQ(body.collisions(), 1);
  EXPECT_TRUE(body.in_contact());
  drive(body, -1, -1, empty_world());
  EXPECT_NEAR(body.pose().x_m, 4 - 0.105, 3e-3);
  EXPECT_FALSE(body.in_contact());
}

TEST(RobotBody, StopsAtAnotherRobot) {
  RobotBody body({}, {}, {}, 1);
  const TruePose other{1, 0, 0};
  drive(body, 2, 2, empty_world(), {&other, 1});
  EXPECT_NEAR(body.pose().x_m, 1 - 0.21, 1.1e-3);
  EXPECT_EQ(body.collisions(), 1);
}

TEST(RobotBody, SlipSpreadsAsTheSquareRootOfTheDistance) {
  // Each wheel's slip after 1 m has deviation s; forward is their mean: s / sqrt(2).
  OdometryNoise noise;
  noise.slip_m_per_sqrt_m = 0.01;
  double sum_squares = 0;
  constexpr int kRuns = 400;
  for (int run = 0; run < kRuns; ++run) {
    RobotBody body({}, {}, noise, static_cast<std::uint64_t>(run));
    drive(body, 1, 1, empty_world());
    const double path_error = std::hypot(body.pose().x_m, body.pose().y_m) - 1;
    sum_squares += path_error * path_error;
  }
  EXPECT_NEAR(std::sqrt(sum_squares / kRuns), 0.01 / std::sqrt(2.0), 0.002);
}

TEST(RobotBody, SameSeedSameMotion) {
  const auto run = [](std::uint64_t seed) {
    RobotBody body({}, {}, OdometryNoise::preset("mild"), seed);
    drive(body, 3, 3, empty_world());
    return body.pose().y_m;
  };
  EXPECT_EQ(run(5), run(5));
  EXPECT_NE(run(5), run(6));
  EXPECT_EQ(
      [] {
        RobotBody body({}, {}, OdometryNoise::preset("none"), 9);
        drive(body, 3, 3, empty_world());
        return body.pose().y_m;
      }(),
      0);
  EXPECT_THROW(OdometryNoise::preset("huge"), std::invalid_argument);
}

TEST(DiscTouchesObstacle, MeasuresToTheCellsEdgeAndOutsideIsSolid) {
  World world = empty_world();
  world.occupied[50 * 100 + 60] = 1;  // x 1.0 .. 1.1, y 0 .. 0.1
  EXPECT_FALSE(disc_touches_obstacle(world, 0.89, 0.05, 0.105));
  EXPECT_TRUE(disc_touches_obstacle(world, 0.90, 0.05, 0.105));
  EXPECT_TRUE(disc_touches_obstacle(world, 4.9, 0, 0.105));
  EXPECT_FALSE(disc_touches_obstacle(world, 4.89, 0, 0.105));
}

TEST(RayToDisc, MeetsMissesAndStartsInside) {
  EXPECT_DOUBLE_EQ(ray_to_disc_m(0, 0, 0, {2, 0, 0}, 0.5), 1.5);
  EXPECT_TRUE(std::isinf(ray_to_disc_m(0, 0, M_PI, {2, 0, 0}, 0.5)));
  EXPECT_TRUE(std::isinf(ray_to_disc_m(0, 0.6, 0, {2, 0, 0}, 0.5)));
  EXPECT_EQ(ray_to_disc_m(2.1, 0, 0, {2, 0, 0}, 0.5), 0);
}

}  // namespace
}  // namespace ivfm::host

// A differential-drive robot's body in a world: true motion, wheel slip and contact with obstacles.
#pragma once

#include <cstdint>
#include <random>
#include <span>
#include <string>

#include "host/environment/world.h"

namespace ivfm::host {

// A true pose in the map frame, in metres and radians; the simulator's own precision.
struct TruePose {
  double x_m = 0;
  double y_m = 0;
  double heading_rad = 0;
};

TruePose to_true_pose(const Pose& pose);

// A TurtleBot3 Burger (ROBOTIS e-manual, "Hardware specifications").
struct BodyShape {
  double radius_m = 0.105;
  double wheel_base_m = 0.160;  // between the wheels' contact points
  double wheel_radius_m = 0.033;
};

// How the wheels' true travel differs from what the encoders say. The model of Borenstein and Feng,
// "Measurement and correction of systematic odometry errors in mobile robots" (1996): unequal wheel
// diameters and an uncertain wheel base are systematic; slip is random with a variance that grows
// with the distance rolled. All are drawn once a run from the seed.
struct OdometryNoise {
  double radius_error = 0;       // standard deviation of each wheel's radius error, relative
  double wheel_base_error = 0;   // standard deviation of the wheel base's error, relative
  double slip_m_per_sqrt_m = 0;  // standard deviation of slip after 1 m of rolling

  // `none`; `mild`, a calibrated robot on a hard floor: about 3 degrees after 50 m; `turtlebot`,
  // one as it comes out of its box: some 25 degrees after 100 m, and 1 % of every turn; `harsh`,
  // worn wheels on a slippery floor: a degree a metre, and 3 % of every turn. Throws
  // std::invalid_argument for other names.
  static OdometryNoise preset(const std::string& name);
};

// One robot's body. Wheels turn as commanded; the body follows, with slip, and stops at contact
// (the wheels then spin in place). Units: metres, seconds, radians.
class RobotBody {
 public:
  RobotBody(const BodyShape& shape, const TruePose& start, const OdometryNoise& noise,
            std::uint64_t seed);

  // Rolls the wheels by these encoder distances (metres at the rim of a nominal wheel). `others`:
  // the middles of the other robots, of the same shape. Small steps: at most 5 mm each.
  void roll(double left_m, double right_m, const World& world, std::span<const TruePose> others);

  // The same to the encoders' next reading, in counts; they begin at 0.
  void roll_to(double left_counts, double right_counts, double metres_per_count, const World& world,
               std::span<const TruePose> others);

  // Somebody lifts it up and puts it down there.
  void carry_to(const TruePose& pose) { pose_ = pose; }
  // From now on the wheels move the body by so much of what they roll: 1 on a floor that holds.
  void set_grip(double left, double right) { left_grip_ = left, right_grip_ = right; }

  const TruePose& pose() const { return pose_; }
  const BodyShape& shape() const { return shape_; }
  double travelled_m() const { return travelled_m_; }  // distance the middle really moved
  int collisions() const { return collisions_; }       // contacts, each counted when it begins
  bool in_contact() const { return in_contact_; }

 private:
  bool is_blocked(const TruePose& next, const World& world, std::span<const TruePose> others) const;

  BodyShape shape_;
  TruePose pose_;
  double left_scale_ = 1;
  double right_scale_ = 1;
  double left_grip_ = 1;
  double right_grip_ = 1;
  double slip_m_per_sqrt_m_ = 0;
  double left_counts_ = 0, right_counts_ = 0;
  double travelled_m_ = 0;
  int collisions_ = 0;
  bool in_contact_ = false;
  std::mt19937_64 random_;
};

// Whether a disc overlaps an obstacle cell (cells outside the world are obstacles).
bool disc_touches_obstacle(const World& world, double x_m, double y_m, double radius_m);

// Where a ray from (x, y) in direction `angle_rad` first meets a disc; infinity when it misses, 0
// when it starts inside.
double ray_to_disc_m(double x_m, double y_m, double angle_rad, const TruePose& disc,
                     double radius_m);

}  // namespace ivfm::host

// Simulated people who cross the world: what robots meet that is no wall.
#pragma once

#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "host/environment/world.h"
#include "host/simulator/robot_body.h"

namespace ivfm::host {

// They walk straight on at 0.8 m/s, and another way where a wall or a robot is near. A lidar sees
// their legs: two discs as large as a robot.
class Walkers {
 public:
  static constexpr double kSpeedMPerS = 0.8;
  static constexpr double kRoomM = 0.35;  // from a walker's middle to walls
  static constexpr double kRobotM = 0.7;  // and to the middles of robots

  // `count` of them at places drawn from `seed`, within what can be seen from the first of
  // `robots` and 2 m from all of them. Throws std::invalid_argument when there is no such place.
  Walkers(const World& world, std::span<const TruePose> robots, int count, std::uint64_t seed);

  void step(double seconds, const World& world, std::span<const TruePose> robots);
  // The middles of all legs, two a walker.
  const std::vector<TruePose>& legs() const { return legs_; }

 private:
  bool may_stand(const TruePose& place, const TruePose& before, const World& world,
                 std::span<const TruePose> robots) const;
  void place_legs();

  std::vector<TruePose> walkers_;
  std::vector<TruePose> legs_;
  std::mt19937_64 random_;
};

}  // namespace ivfm::host

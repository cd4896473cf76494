// Simulated robots in one world, and the real map server between them, in simulated time.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "firmware/agent/linux/agent_setup.h"
#include "host/simulator/robot_body.h"
#include "tests/replay/simulated_robot.h"

namespace ivfm {

inline constexpr TimeUs kSecondUs = 1'000'000;

class SimulatedTeam : public testing::Test {
 protected:
  static constexpr TimeUs kTickUs = 2'000;
  static constexpr TimeUs kExchangeUs = 20'000;

  // `start`: where it stands in world_, whatever `config` says.
  void add_robot(const AgentConfig& config, const Pose& start, const std::string& noise,
                 replay::ProfileId profile = replay::ProfileId::kMcu) {
    robots_.push_back(std::make_unique<replay::SimulatedRobot>(
        config, start, world_, host::OdometryNoise::preset(noise), 1, profile));
    team_.add(robots_.back()->radio());
  }
  void tick() {
    now_us_ += kTickUs;
    for (const auto& robot : robots_) {
      std::vector<host::TruePose> others;
      for (const auto& other : robots_) {
        if (other != robot) others.push_back(other->body().pose());
      }
      robot->meet(std::move(others));
      robot->tick(now_us_);
    }
    if (now_us_ % kExchangeUs == 0) team_.exchange(now_us_);
  }
  void run_for(TimeUs duration_us) {
    for (const TimeUs end_us = now_us_ + duration_us; now_us_ < end_us;) tick();
  }

  // How far a robot is from where it believes to be.
  double error_m(std::size_t robot) const {
    const Point believed = robots_[robot]->agent().pose().position;
    const host::TruePose& truth = robots_[robot]->body().pose();
    return std::hypot(believed.x_um * 1e-6 - truth.x_m, believed.y_um * 1e-6 - truth.y_m);
  }
  double error_deg(std::size_t robot) const {
    const double believed = robots_[robot]->agent().pose().heading.radians();
    const double truth = robots_[robot]->body().pose().heading_rad;
    return std::abs(std::remainder(believed - truth, 2 * std::numbers::pi)) * 180 /
           std::numbers::pi;
  }
  // Cells of the map that `is_obstacle` and that lie more than `near_m` from everything.
  template <typename Query>
  int ghosts(double near_m, Query is_obstacle) const {
    constexpr double kCellM = 0.05;
    const auto cells = [this](std::int32_t side) { return side * 1e-6 * world_->cell_um / kCellM; };
    int count = 0;
    for (std::int32_t y = 0; y < cells(world_->height); ++y) {
      for (std::int32_t x = 0; x < cells(world_->width); ++x) {
        if (!is_obstacle(Cell{x, y})) continue;
        const double x_m = (x + 0.5) * kCellM, y_m = (y + 0.5) * kCellM;
        count += host::disc_touches_obstacle(*world_, x_m, y_m, near_m) ? 0 : 1;
      }
    }
    return count;
  }
  // Whether the server soon holds of every robot's window what that robot itself does; robots that
  // stand go on to map.
  bool server_has_the_same() {
    for (const TimeUs end_us = now_us_ + 20 * kSecondUs; now_us_ < end_us;) {
      for (const auto& robot : robots_) robot->agent().flush_map();
      run_for(kExchangeUs);
      int different = 0;
      for (std::size_t i = 0; i < robots_.size(); ++i) different += differences(i);
      if (different == 0) return true;
    }
    return false;
  }

  std::shared_ptr<const host::World> world_;
  std::vector<std::unique_ptr<replay::SimulatedRobot>> robots_;
  host::TeamRadio team_;
  TimeUs now_us_ = 5 * kSecondUs;

 private:
  int differences(std::size_t robot) const {
    const ExplorationMap& map = robots_[robot]->agent().explorer().map();
    const CellRect& window = map.frame().window();
    const auto id = static_cast<std::uint16_t>(robot + 1);
    int count = 0;
    for (const Layer layer : {Layer::kVisits, Layer::kObstacles}) {
      for (std::int32_t y = window.y; y < window.top(); ++y) {
        for (std::int32_t x = window.x; x < window.right(); ++x) {
          std::uint8_t own = 0;
          if (!ok(map.read_own(layer, {x, y, 1, 1}, {&own, 1}))) continue;
          count += own != team_.server().map().robot_value(id, layer, {x, y}) ? 1 : 0;
        }
      }
    }
    return count;
  }
};

}  // namespace ivfm

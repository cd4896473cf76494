// A robot for tests of the link: explores at random, and remembers what it was told to be safe.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <random>

#include "firmware/link/map_link.h"
#include "tests/support/fake_map.h"

namespace ivfm::host {

inline constexpr std::array kLayers{Layer::kVisits, Layer::kObstacles};

class TeamRobot {
 public:
  static constexpr CellRect kWindow{-40, -40, 90, 70};

  // `radio` must outlive the robot. It runs at once.
  TeamRobot(std::uint16_t id, DatagramSocket& radio) : id_(id), radio_(radio) { start(); }

  // With an empty map.
  void start() {
    MapLinkConfig config;
    config.robot = id_;
    config.epoch = kEpoch;  // always the same: the server gives out others
    config.boot = next_boot_++;
    config.name = "robot";
    config.batch_period_us = 300'000;
    map_.emplace(kWindow);
    link_.emplace(*map_, radio_, config);
    link_->clip(kWindow);
  }
  // Everything it knew is gone.
  void kill() {
    note_acknowledged(kWindow);
    link_.reset();
    map_.reset();
  }
  bool runs() const { return link_.has_value(); }

  std::uint16_t id() const { return id_; }
  const MapLink& link() const { return *link_; }
  const fake::SmallMap& map() const { return *map_; }
  void step(TimeUs now_us, const Pose& pose = {}) {
    link_->step(now_us, pose);
    for (const Layer layer : kLayers) link_->mark_dirty(layer, map_->take_changes(layer));
  }

  // Now and then it sees a place: counts visits, finds obstacles there or finds them gone.
  void explore(std::mt19937& random) {
    if (random() % 4 != 0) return;
    const Layer layer = kLayers[random() % kLayers.size()];
    const auto below = [&random](std::int32_t limit) {
      return static_cast<std::int32_t>(random() % static_cast<std::uint32_t>(limit));
    };
    const CellRect seen =
        CellRect{kWindow.x + below(kWindow.width), kWindow.y + below(kWindow.height),
                 1 + below(kMaxSide), 1 + below(kMaxSide)}
            .intersection(kWindow);
    if (layer == Layer::kVisits) note_acknowledged(seen);
    const auto obstacle = static_cast<std::uint8_t>(random() % 2);
    fake::for_each_cell(seen, [&](Cell c) {
      const auto visits = static_cast<std::uint8_t>(std::min(255, map_->own(layer, c) + 1));
      map_->set_own(layer, c, layer == Layer::kObstacles ? obstacle : visits);
    });
    link_->mark_dirty(layer, seen);
  }

  bool is_acknowledged(Layer layer, Cell c) const {
    return link_->is_acknowledged(layer, {c.x, c.y, 1, 1});
  }
  // So many visits of each cell the server has said to have, at least.
  const fake::SmallMap& acknowledged_visits() {
    if (runs()) note_acknowledged(kWindow);
    return acknowledged_;
  }

 private:
  static constexpr std::int32_t kMaxSide = 12;
  static constexpr std::uint32_t kEpoch = 10;

  void note_acknowledged(const CellRect& rect) {
    fake::for_each_cell(rect, [&](Cell c) {
      const std::uint8_t value = map_->own(Layer::kVisits, c);
      if (value != 0 && is_acknowledged(Layer::kVisits, c)) {
        acknowledged_.set_own(Layer::kVisits, c, value);
      }
    });
  }

  std::uint16_t id_;
  std::uint64_t next_boot_ = 1;
  DatagramSocket& radio_;
  std::optional<fake::SmallMap> map_;  // none while the robot is down
  std::optional<MapLink> link_;
  fake::SmallMap acknowledged_{kWindow};
};

}  // namespace ivfm::host

#include "host/simulator/walkers.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "host/simulator/world_region.h"

namespace ivfm::host {
namespace {

constexpr double kHalfStanceM = 0.12;
constexpr double kStartM = 2;  // from every robot
constexpr int kTries = 100'000;

double distance_m(const TruePose& a, const TruePose& b) {
  return std::hypot(a.x_m - b.x_m, a.y_m - b.y_m);
}

// Even in [0, 1), the same on every machine.
double share(std::mt19937_64& random) { return static_cast<double>(random() >> 11) * 0x1p-53; }

}  // namespace

Walkers::Walkers(const World& world, std::span<const TruePose> robots, int count,
                 std::uint64_t seed)
    : random_(seed) {
  if (count == 0) return;
  const Point first{static_cast<std::int32_t>(std::lround(robots[0].x_m * 1e6)),
                    static_cast<std::int32_t>(std::lround(robots[0].y_m * 1e6))};
  const std::vector<std::uint8_t> visible = visible_region(world, first);
  for (int tries = 0; static_cast<int>(walkers_.size()) < count; ++tries) {
    if (tries == kTries) throw std::invalid_argument("there is no room for so many walkers");
    const std::size_t cell = random_() % visible.size();
    const auto width = static_cast<std::size_t>(world.width);
    const double cell_m = world.cell_um / 1e6;
    const TruePose place{
        world.origin.x_um / 1e6 + (static_cast<double>(cell % width) + 0.5) * cell_m,
        world.origin.y_um / 1e6 + (static_cast<double>(cell / width) + 0.5) * cell_m,
        share(random_) * 2 * M_PI};
    const bool far = std::all_of(robots.begin(), robots.end(), [&](const TruePose& robot) {
      return distance_m(place, robot) > kStartM;
    });
    if (visible[cell] == 0 || !far) continue;
    if (!disc_touches_obstacle(world, place.x_m, place.y_m, kRoomM)) walkers_.push_back(place);
  }
  place_legs();
}

bool Walkers::may_stand(const TruePose& place, const TruePose& before, const World& world,
                        std::span<const TruePose> robots) const {
  if (disc_touches_obstacle(world, place.x_m, place.y_m, kRoomM)) return false;
  return std::all_of(robots.begin(), robots.end(), [&](const TruePose& robot) {
    const double gap = distance_m(place, robot);
    return gap > kRobotM || gap > distance_m(before, robot);  // leaving is always right
  });
}

void Walkers::step(double seconds, const World& world, std::span<const TruePose> robots) {
  for (TruePose& walker : walkers_) {
    TruePose next = walker;
    next.x_m += kSpeedMPerS * seconds * std::cos(walker.heading_rad);
    next.y_m += kSpeedMPerS * seconds * std::sin(walker.heading_rad);
    if (may_stand(next, walker, world, robots)) {
      walker = next;
    } else {
      walker.heading_rad = share(random_) * 2 * M_PI;  // stands for this step
    }
  }
  place_legs();
}

void Walkers::place_legs() {
  legs_.clear();
  for (const TruePose& walker : walkers_) {
    for (const double side : {-kHalfStanceM, kHalfStanceM}) {
      legs_.push_back({walker.x_m - side * std::sin(walker.heading_rad),
                       walker.y_m + side * std::cos(walker.heading_rad), walker.heading_rad});
    }
  }
}

}  // namespace ivfm::host

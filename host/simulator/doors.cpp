#include "host/simulator/doors.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string_view>

#include "host/cli/take_text.h"

namespace ivfm::host {
namespace {

bool stands_in(const Door& door, const TruePose& body, double radius_m) {
  const double dx = body.x_m - std::clamp(body.x_m, door.x0_m, door.x1_m);
  const double dy = body.y_m - std::clamp(body.y_m, door.y0_m, door.y1_m);
  return std::hypot(dx, dy) < radius_m;
}

}  // namespace

Door parse_door(const std::string& text) {
  const auto fail = [&] {
    return std::invalid_argument(
        "door '" + text +
        "' must be X0,Y0,X1,Y1@CLOSES[+LENGTH] with X0 < X1 and Y0 < Y1 in "
        "metres and times such as 20s, for example 3,1,3.1,2@20s+15s");
  };
  Door door;
  int used = 0;
  const int fields = std::sscanf(text.c_str(), "%lf,%lf,%lf,%lf@%n", &door.x0_m, &door.y0_m,
                                 &door.x1_m, &door.y1_m, &used);
  if (fields != 4 || used == 0 || !(door.x0_m < door.x1_m) || !(door.y0_m < door.y1_m))
    throw fail();
  std::string_view rest = std::string_view(text).substr(static_cast<std::size_t>(used));
  const auto close_us = take_time(rest);
  if (!close_us) throw fail();
  door.close_us = *close_us;
  if (take_prefix(rest, "+")) {
    const auto length_us = take_time(rest);
    if (!length_us) throw fail();
    door.open_us = door.close_us + *length_us;
  }
  if (!rest.empty()) throw fail();
  return door;
}

Doors::Doors(const World& world, const std::vector<Door>& doors) {
  for (const Door& door : doors) {
    Leaf leaf{door, {}};
    for (std::size_t i = 0; i < world.occupied.size(); ++i) {
      const auto width = static_cast<std::size_t>(world.width);
      const double cell_m = world.cell_um / 1e6;
      const double x_m = world.origin.x_um / 1e6 + (static_cast<double>(i % width) + 0.5) * cell_m;
      const double y_m = world.origin.y_um / 1e6 + (static_cast<double>(i / width) + 0.5) * cell_m;
      const bool inside =
          x_m >= door.x0_m && x_m <= door.x1_m && y_m >= door.y0_m && y_m <= door.y1_m;
      if (inside && world.occupied[i] == 0) leaf.cells.push_back(i);
    }
    if (leaf.cells.empty()) {
      throw std::invalid_argument("a door has no free floor of the world " + world.name +
                                  " to close");
    }
    leaves_.push_back(std::move(leaf));
  }
}

bool Doors::step(TimeUs now_us, World& world, std::span<const TruePose> bodies, double radius_m) {
  bool changed = false;
  for (Leaf& leaf : leaves_) {
    const bool closed = now_us >= leaf.door.close_us && now_us < leaf.door.open_us;
    if (closed == leaf.closed) continue;
    const bool free = std::ranges::none_of(
        bodies, [&](const TruePose& body) { return stands_in(leaf.door, body, radius_m); });
    if (closed && !free) continue;
    leaf.closed = closed;
    for (const std::size_t i : leaf.cells) world.occupied[i] = closed ? 1 : 0;
    changed = true;
  }
  return changed;
}

}  // namespace ivfm::host

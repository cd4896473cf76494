#include "host/simulator/world_catalog.h"

#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "host/environment/arena_worlds.h"
#include "host/environment/building_worlds.h"
#include "host/simulator/corridor_world.h"
#include "host/simulator/map_file.h"
#include "host/simulator/world_region.h"

namespace ivfm::host {
namespace {

constexpr int kMaxRobots = 8;

PreparedWorld from_scenario(const Scenario& scenario, std::string name) {
  PreparedWorld prepared{*scenario.world, scenario.starts, {}};
  prepared.world.name = std::move(name);
  return prepared;
}

PreparedWorld with_random_starts(World world, const WorldRequest& request) {
  PreparedWorld prepared{std::move(world), {}, {}};
  if (!request.starts.empty()) return prepared;
  const auto radius_um = static_cast<std::int32_t>(prepared.body.radius_m * 1e6);
  prepared.starts = random_start_poses(prepared.world, request.robots, radius_um, request.seed);
  return prepared;
}

PreparedWorld load_named_world(const WorldRequest& request) {
  if (const auto arena = arena_from_name(request.name)) {
    PreparedWorld prepared =
        from_scenario(random_arena(*arena, request.robots, request.seed), request.name);
    prepared.body.radius_m = arena::kRobotRadiusUm / 1e6;
    return prepared;
  }
  if (request.name == "building") {
    return from_scenario(random_building({}, request.robots, request.seed), request.name);
  }
  if (request.name == "malaga") return with_random_starts(malaga_world(), request);
  if (request.name == "corridor") {
    if (request.random_starts) return with_random_starts(corridor_world(), request);
    return {corridor_world(), corridor_start_poses(request.robots), {}};
  }
  if (request.name.find('.') == std::string::npos) {
    throw std::invalid_argument("world '" + request.name +
                                "' is unknown: use 1x, 2x, divider, divider-released, building, "
                                "corridor, malaga, or a map file (.yaml, .pgm, .png)");
  }
  return with_random_starts(load_map_file(request.name, request.resolution_m), request);
}

void check_starts(const PreparedWorld& prepared, int robots) {
  if (static_cast<int>(prepared.starts.size()) != robots) {
    throw std::invalid_argument(std::to_string(prepared.starts.size()) +
                                " start poses are given for " + std::to_string(robots) + " robots");
  }
  for (std::size_t i = 0; i < prepared.starts.size(); ++i) {
    const TruePose pose = to_true_pose(prepared.starts[i]);
    if (disc_touches_obstacle(prepared.world, pose.x_m, pose.y_m, prepared.body.radius_m)) {
      throw std::invalid_argument("start pose " + format_pose(prepared.starts[i]) + " of robot " +
                                  std::to_string(i + 1) + " touches an obstacle of world " +
                                  prepared.world.name);
    }
    for (std::size_t j = 0; j < i; ++j) {
      const TruePose other = to_true_pose(prepared.starts[j]);
      const double gap_m = std::hypot(pose.x_m - other.x_m, pose.y_m - other.y_m);
      if (gap_m < 2 * prepared.body.radius_m) {
        throw std::invalid_argument("the start poses of robots " + std::to_string(j + 1) + " and " +
                                    std::to_string(i + 1) + " overlap");
      }
    }
  }
}

}  // namespace

PreparedWorld prepare_world(const WorldRequest& request) {
  if (request.robots < 1 || request.robots > kMaxRobots) {
    throw std::invalid_argument("the number of robots must be 1 to " + std::to_string(kMaxRobots));
  }
  PreparedWorld prepared = load_named_world(request);
  if (!request.starts.empty()) prepared.starts = request.starts;
  check_starts(prepared, request.robots);
  return prepared;
}

Pose parse_pose(const std::string& text) {
  double x_m = 0, y_m = 0, heading_deg = 0;
  int used = 0;
  const int fields = std::sscanf(text.c_str(), "%lf,%lf,%lf%n", &x_m, &y_m, &heading_deg, &used);
  const bool is_whole = fields == 3 && static_cast<std::size_t>(used) == text.size();
  if (!is_whole || !(std::abs(x_m) < 2000) || !(std::abs(y_m) < 2000) ||
      !(std::abs(heading_deg) <= 720)) {
    throw std::invalid_argument("pose '" + text +
                                "' must be x,y,heading in metres and degrees, such as 1.5,-2,90");
  }
  return {{static_cast<std::int32_t>(std::lround(x_m * 1e6)),
           static_cast<std::int32_t>(std::lround(y_m * 1e6))},
          BinaryAngle::from_degrees(heading_deg)};
}

std::string format_pose(const Pose& pose) {
  char text[64];
  std::snprintf(text, sizeof text, "%.6f,%.6f,%.2f", pose.position.x_um / 1e6,
                pose.position.y_um / 1e6, pose.heading.degrees());
  return text;
}

}  // namespace ivfm::host

// Worlds by name for the evaluator: arenas, random buildings, the recorded corridor and map files.
#include <filesystem>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "host/environment/arena_worlds.h"
#include "host/environment/building_worlds.h"
#include "host/environment/random.h"
#include "host/environment/reachable_area.h"
#include "host/evaluation/evaluator.h"
#include "host/evaluation/file_hash.h"
#include "host/simulator/corridor_world.h"
#include "host/simulator/map_file.h"

namespace ivfm::host {

namespace {

constexpr std::int32_t kDefaultRangeUm = 3'000'000;

EnvironmentConfig map_config(const WorldOptions& options, double default_until) {
  if (options.every_place) {
    throw std::invalid_argument("--every-place is for arenas: in a map there is no target to find");
  }
  const double range_m = options.sensor_range_m.value_or(kDefaultRangeUm * 1e-6);
  if (!(range_m >= 0.2 && range_m <= 12)) {
    throw std::invalid_argument("--sensor-range is 0.2 to 12 metres");
  }
  const double visit_range_m = options.visit_range_m.value_or(range_m);
  if (!(visit_range_m >= 0.2 && visit_range_m <= range_m)) {
    throw std::invalid_argument("--visit-range is 0.2 metres to the sensor's range");
  }
  const double fov_deg = options.fov_deg.value_or(360);
  if (!(fov_deg >= 10 && fov_deg <= 360)) {
    throw std::invalid_argument("--fov is 10 to 360 degrees");
  }
  EnvironmentConfig config =
      EnvironmentConfig::building(static_cast<std::int32_t>(visit_range_m * 1e6));
  config.sensor_range_um = static_cast<std::int32_t>(range_m * 1e6);
  config.explorer.fusion.mapping_range_um = config.sensor_range_um;
  config.until_coverage = options.until.value_or(default_until);
  if (!(config.until_coverage > 0 && config.until_coverage <= 1)) {
    throw std::invalid_argument("--until is a share of the area: above 0, at most 1");
  }
  config.max_actions_per_agent = 5'000;
  const double visit_fov_deg = options.visit_fov_deg.value_or(fov_deg);
  if (!(visit_fov_deg >= 10 && visit_fov_deg <= fov_deg)) {
    throw std::invalid_argument("--visit-fov is 10 degrees to the sensor's field of view");
  }
  if (fov_deg < 360) config.sensor_half_angle = BinaryAngle::from_degrees(fov_deg / 2).raw();
  if (visit_fov_deg < 360) {
    config.explorer.fusion.footprint.half_angle =
        BinaryAngle::from_degrees(visit_fov_deg / 2).raw();
  }
  if (options.network_decides) {
    config.explorer.let_network_decide();
    config.max_travel_um = 0;
  }
  return config;
}

// Robots on random free places that can all reach each other; the first one where it is wanted.
std::vector<Pose> map_starts(const RayCaster& rays, const EnvironmentConfig& config, int agents,
                             const std::optional<Pose>& first, std::uint64_t seed) {
  const GridFrame frame(config.cell_um, extent_of(rays.world(), config.cell_um));
  const std::int32_t room_um = config.explorer.robot_radius_um + config.cell_um;
  Random random(seed, 2);
  const auto draw = [&](const std::vector<std::uint8_t>* allowed) -> Pose {
    for (int tries = 0; tries < 100'000; ++tries) {
      const std::size_t i = random.below(static_cast<std::uint32_t>(frame.size()));
      const Point p = frame.center_of(frame.cell_of_index(i));
      if (allowed ? (*allowed)[i] == 0 : !rays.disc_is_free(p, room_um)) continue;
      return {p, BinaryAngle(static_cast<std::uint16_t>(random.below(65536)))};
    }
    throw std::runtime_error("the world has no room for the robots");
  };
  std::vector<Pose> starts{first ? *first : draw(nullptr)};
  if (!rays.disc_is_free(starts[0].position, config.body_radius_um)) {
    throw std::invalid_argument("--start touches an obstacle or lies outside the map");
  }
  const auto reached = reachable_centers(rays, frame, frame.cell_at(starts[0].position), room_um);
  const std::int64_t apart = 2 * std::int64_t{room_um};
  for (int tries = 0; static_cast<int>(starts.size()) < agents; ++tries) {
    if (tries > 10'000) throw std::runtime_error("the world has no room for that many robots");
    const Pose pose = draw(&reached);
    bool is_apart = true;
    for (const Pose& other : starts) {
      is_apart &= squared_distance_um2(other.position, pose.position) >= apart * apart;
    }
    if (is_apart) starts.push_back(pose);
  }
  return starts;
}

// What tells two maps apart.
std::string text_of(const World& world) {
  return sha256_of({world.occupied.begin(), world.occupied.end()}).substr(0, 12);
}

EvaluationWorld map_world(const WorldOptions& options, World world, double default_until) {
  EvaluationWorld result;
  result.name = options.name;
  result.config = map_config(options, default_until);
  result.is_map = true;
  result.identity = ' ' + text_of(world);
  const auto shared = std::make_shared<const World>(std::move(world));
  const auto rays = std::make_shared<const RayCaster>(shared);
  result.scenario = [shared, rays, config = result.config, first = options.start](
                        int agents, std::uint64_t seed) {
    Scenario scenario;
    scenario.world = shared;
    scenario.rays = rays;
    scenario.starts = map_starts(*rays, config, agents, first, seed);
    return scenario;
  };
  return result;
}

EvaluationWorld arena_world(const WorldOptions& options, ArenaKind kind) {
  if (options.until || options.sensor_range_m || options.visit_range_m || options.fov_deg ||
      options.visit_fov_deg || options.network_decides || options.start) {
    throw std::invalid_argument(
        "--until, --sensor-range, --visit-range, --fov, --visit-fov, --network-decides and "
        "--start are for map files; " +
        options.name + " is an arena with the paper's camera");
  }
  EvaluationWorld result;
  result.name = options.name;
  result.config = EnvironmentConfig::arena();
  result.config.reroute_when_blocked = options.reroute;
  result.config.walls_known = options.walls_known;
  result.config.count_last_view = options.count_last_view;
  result.scenario = [kind, everywhere = options.every_place](int agents, std::uint64_t seed) {
    Scenario arena = random_arena(kind, agents, seed);
    return everywhere ? with_target_everywhere(std::move(arena)) : arena;
  };
  return result;
}

// All that was asked for, in one line.
std::string text_of(const WorldOptions& o) {
  std::ostringstream text;
  text << o.name;
  const auto add = [&](const char* name, const auto& value) {
    if (value) text << ' ' << name << '=' << *value;
  };
  text.precision(12);
  add("resolution", o.resolution_m);
  add("until", o.until);
  add("range", o.sensor_range_m);
  add("visit-range", o.visit_range_m);
  add("visit-fov", o.visit_fov_deg);
  add("fov", o.fov_deg);
  if (o.start) {
    text << " start=" << o.start->position.x_um << ';' << o.start->position.y_um << ';'
         << o.start->heading.raw();
  }
  text << (o.every_place ? " every-place" : "") << (o.walls_known ? " walls-known" : "")
       << (o.count_last_view ? " count-last-view" : "") << (o.reroute ? " reroute" : "")
       << (o.network_decides ? " network-decides" : "");
  return text.str();
}

EvaluationWorld named_world(const WorldOptions& options) {
  if (const auto kind = arena_from_name(options.name)) return arena_world(options, *kind);
  if (options.name == "corridor") return map_world(options, corridor_world(), 0.5);
  if (options.name == "building") {
    EvaluationWorld result;
    result.name = options.name;
    result.config = map_config(options, 0.99);
    result.is_map = true;
    result.scenario = [](int agents, std::uint64_t seed) {
      return random_building({}, agents, seed);
    };
    return result;
  }
  if (!std::filesystem::exists(options.name)) {
    throw std::invalid_argument("unknown world '" + options.name +
                                "': use 1x, 2x, divider, divider-released, corridor, building, or "
                                "the path of a map file (.yaml, .pgm, .png)");
  }
  return map_world(options, load_map_file(options.name, options.resolution_m), 0.99);
}

}  // namespace

EvaluationWorld make_world(const WorldOptions& options) {
  EvaluationWorld world = named_world(options);
  world.identity = text_of(options) + world.identity;
  return world;
}

}  // namespace ivfm::host

// `record_agent`: writes the replay files that the tests play on every target.
//   record_agent corridor MODEL OUT   two agents in the corridor; the first one's ports
//   record_agent matching MODEL OUT   the same with worse odometry, corrected by matching scans
//   record_agent arena MODEL OUT      the explorer's calls in the paper's arenas
//   record_agent model OUT            a model with random weights, where none is trained yet
#include <array>
#include <cmath>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>
#include <memory>
#include <stdexcept>
#include <string>

#include "firmware/agent/linux/agent_setup.h"
#include "firmware/nn/q_network.h"
#include "host/environment/arena_worlds.h"
#include "host/environment/exploration_environment.h"
#include "host/map_server/team_radio.h"
#include "host/quantizer/quantizer.h"
#include "host/quantizer/robot_model.h"
#include "host/simulator/corridor_world.h"
#include "tests/replay/simulated_robot.h"

namespace ivfm::replay {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kSeed = 8;
constexpr std::size_t kMaxFileBytes = 1'450'000;
constexpr std::size_t kMaxMatchingBytes = 1'000'000;
constexpr std::uint32_t kMaxDecisions = 300;
constexpr std::uint32_t kArenaDecisions = 200;
constexpr std::uint64_t kMaxEpisodes = 24;
constexpr TimeUs kTickUs = 2'000;
constexpr TimeUs kLongestUs = 1'800'000'000;

void write_file(const fs::path& path, const std::vector<std::uint8_t>& bytes) {
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
  if (!file.flush()) throw std::runtime_error("cannot write " + path.string());
}

AgentConfig corridor_config(const Pose& start, std::uint16_t robot, bool matching) {
  AgentOptions options;
  options.robot_id = robot;
  options.visit_range_m = 1;
  if (!matching) {  // more decisions a recorded second; turning so fast, a lidar sees little
                    // sharply
    options.max_speed_m_s = 0.5;
    options.max_turn_rad_s = 3;
  }
  options.localization = matching ? LocalizationChoice::kMatching : LocalizationChoice::kOdometry;
  AgentConfig config = make_agent_config(options, McuProfile::kCellUm, 1);
  config.start = start;
  return config;
}

double distance_m(const host::TruePose& truth, const Pose& believed) {
  return std::hypot(truth.x_m - believed.position.x_um / 1e6,
                    truth.y_m - believed.position.y_um / 1e6);
}

void record_corridor(const std::vector<std::uint8_t>& model, bool matching, const fs::path& out) {
  const auto world = std::make_shared<const host::World>(host::corridor_world());
  const std::vector<Pose> starts = host::corridor_start_poses(2);
  const auto noise = host::OdometryNoise::preset(matching ? "turtlebot" : "mild");
  std::vector<std::unique_ptr<SimulatedRobot>> robots;
  for (std::uint16_t i = 0; i < 2; ++i) {
    const auto robot = static_cast<std::uint16_t>(i + 1);
    robots.push_back(std::make_unique<SimulatedRobot>(
        as_stored(corridor_config(starts[i], robot, matching)), starts[i], world, noise, kSeed));
    const ModelStatus loaded = robots[i]->agent().load_model(model);
    if (!ok(loaded.status)) throw std::runtime_error(std::string("bad model: ") + loaded.reason);
  }
  host::TeamRadio team;
  for (const auto& robot : robots) team.add(robot->radio());
  SimulatedRobot& recorded = *robots[0];
  TimeUs now_us = 5'000'000;
  const TimeUs begin_us = now_us;
  while (recorded.writer().size() < (matching ? kMaxMatchingBytes : kMaxFileBytes) &&
         recorded.agent().progress().actions < kMaxDecisions && now_us < kLongestUs) {
    now_us += kTickUs;
    for (const auto& robot : robots) robot->tick(now_us);
    if (now_us % 20'000 == 0) team.exchange(now_us);
  }
  write_file(out, recorded.recording());
  const AgentProgress& progress = recorded.agent().progress();
  std::printf(
      "%s: %.1f s, %u actions (%u global), %u scans, %.1f m, %.3f m off, %d collisions, %zu "
      "bytes\n",
      out.c_str(), static_cast<double>(now_us - begin_us) / 1e6, progress.actions,
      progress.global_actions, progress.scans_fused, recorded.body().travelled_m(),
      distance_m(recorded.body().pose(), recorded.agent().pose()), recorded.body().collisions(),
      static_cast<std::size_t>(fs::file_size(out)));
}

// Episodes of single robots in arenas of all kinds, one after the other, the same explorer.
void record_arena(const std::vector<std::uint8_t>& model, const fs::path& out) {
  auto network = std::make_unique<QNetwork>();
  const ModelStatus loaded = network->load(model);
  if (!ok(loaded.status)) throw std::runtime_error(std::string("bad model: ") + loaded.reason);
  host::EnvironmentConfig config = host::EnvironmentConfig::arena();
  config.max_actions_per_agent = 60;
  config.count_first_view = true;  // else there is no frontier to begin with
  Header header{Subject::kExplorer, ProfileId::kPaper, {}};
  header.config.explorer = config.explorer;
  ReplayWriter writer(header);
  std::uint32_t decisions = 0, local = 0;
  constexpr std::array kKinds = {host::ArenaKind::k1x, host::ArenaKind::k2x,
                                 host::ArenaKind::kDivider, host::ArenaKind::kDividerReleased};
  for (std::uint64_t episode = 0; episode < kMaxEpisodes && decisions < kArenaDecisions;
       ++episode) {
    host::ExplorationEnvironment environment(config);
    environment.set_observer([&](int, host::ExplorerCall call, const Pose& pose, Point center,
                                 const Scan* scan, bool count_visits) {
      switch (call) {
        case host::ExplorerCall::kStart: writer.start(pose, center); break;
        case host::ExplorerCall::kBeginAction: writer.begin_action(); break;
        case host::ExplorerCall::kFuse: writer.fuse(pose, *scan, count_visits); break;
        case host::ExplorerCall::kAbandonGoal: writer.abandon_goal(); break;
      }
    });
    environment.reset(host::random_arena(kKinds[episode % kKinds.size()], 1, kSeed + episode));
    while (!environment.is_done()) {
      const Pose pose = environment.pose(0);
      writer.decide(pose);
      const Decision decision = environment.explorer(0).decide(pose, *network);
      ++decisions;
      local += decision.kind == Decision::Kind::kLocalGoal ? 1 : 0;
      if (decision.kind == Decision::Kind::kExplored) break;
      environment.step_decision(0, decision);
    }
  }
  write_file(out, writer.finish());
  std::printf("%s: %u decisions (%u local goals), %zu bytes\n", out.c_str(), decisions, local,
              static_cast<std::size_t>(fs::file_size(out)));
}

void make_model(const fs::path& out) {
  const auto network = host::make_random_network(kSeed);
  write_file(out, host::quantize(network, host::make_example_states(kSeed, 50)));
  std::printf("%s: %zu bytes\n", out.c_str(), static_cast<std::size_t>(fs::file_size(out)));
}

int run(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "";
  if (what == "model" && argc == 3) {
    make_model(argv[2]);
  } else if (what == "corridor" && argc == 4) {
    record_corridor(host::read_model_file(argv[2]), false, argv[3]);
  } else if (what == "matching" && argc == 4) {
    record_corridor(host::read_model_file(argv[2]), true, argv[3]);
  } else if (what == "arena" && argc == 4) {
    record_arena(host::read_model_file(argv[2]), argv[3]);
  } else {
    std::fputs("usage: record_agent corridor|matching MODEL OUT | arena MODEL OUT | model OUT\n",
               stderr);
    return 2;
  }
  return 0;
}

}  // namespace
}  // namespace ivfm::replay

int main(int argc, char** argv) {
  try {
    return ivfm::replay::run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "record_agent: %s\n", error.what());
    return 1;
  }
}

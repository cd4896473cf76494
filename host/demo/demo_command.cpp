#include "host/demo/demo_command.h"

#include <atomic>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "host/demo/demo_run.h"
#include "host/demo/run_options.h"
#include "host/radio/radio_faults.h"

namespace ivfm::host {
namespace {

std::atomic<bool> g_interrupted{false};

void on_signal(int) { g_interrupted = true; }

// The command line as it was typed, to be shown again.
std::string command_line() {
  std::ifstream in("/proc/self/cmdline", std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(in), {}};
  while (!text.empty() && text.back() == '\0') text.pop_back();
  for (char& c : text) {
    if (c == '\0') c = ' ';
  }
  return text;
}

int demonstrate(DemoOptions options, double resolution_m) {
  if (resolution_m > 0) options.world.resolution_m = resolution_m;
  options.command_line = command_line();
  struct sigaction action {};
  action.sa_handler = on_signal;
  for (const int signal_number : {SIGINT, SIGTERM, SIGHUP}) {
    sigaction(signal_number, &action, nullptr);
  }
  signal(SIGPIPE, SIG_IGN);
  try {
    return DemoRun(options, g_interrupted).run().good() ? 0 : 1;
  } catch (const Interrupted&) {
    std::fprintf(stderr, "ivfm: interrupted; all processes are stopped\n");
    return 1;
  }
}

// What `parse` answers; what it finds wrong is a usage error of `flag`.
template <typename Parse>
auto checked(const char* flag, const Parse& parse) {
  try {
    return parse();
  } catch (const std::invalid_argument& error) {
    throw CLI::ValidationError(flag, error.what());
  }
}

// Who joins late, leaves or crashes, what the radio does, and what is looked for.
void add_team_options(CLI::App& command, DemoOptions& options) {
  const auto add = [&](const char* flag, FleetEvent::Kind kind, const char* help) {
    command.add_option_function<std::vector<std::string>>(
        flag,
        [&options, flag, kind](const std::vector<std::string>& texts) {
          for (const std::string& text : texts) {
            options.events.push_back(checked(flag, [&] { return parse_fleet_event(kind, text); }));
          }
        },
        help);
  };
  add("--join", FleetEvent::Kind::kJoin, "ROBOT@TIME, such as 3@20s: is switched on then");
  add("--leave", FleetEvent::Kind::kLeave,
      "ROBOT@TIME[+PAUSE]: hands over its map and ends [and comes back]");
  add("--crash", FleetEvent::Kind::kCrash,
      "ROBOT@TIME[+PAUSE], such as 2@30s+10s: kill -9 [and started again]");
  command.add_option_function<std::string>(
      "--radio",
      [&options](const std::string& text) {
        RadioFaults faults;
        checked("--radio", [&] { return add_radio_faults(faults, text), 0; });
        options.radio = text;
      },
      "faults between robots and server, such as drop=0.3,jitter=200ms,partition@30s+20s");
  command.add_option("--target", options.target,
                     "X,Y in metres: the robot that sees it ends the search for all");
}

void add_process_options(CLI::App& command, DemoOptions& options) {
  command.add_option("--policy", options.policy, "qnet or frontier-nearest")
      ->capture_default_str()
      ->check(CLI::IsMember({"qnet", "frontier-nearest"}));
  command.add_option("--agent", options.agent, "program of the robots [ivfm-agent beside this]");
  command.add_option("--out", options.out, "folder for the results")->capture_default_str();
  command.add_option("--time-scale", options.time_scale, "robots' seconds in a real one")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 20.0));
}

}  // namespace

void add_demo_command(CLI::App& app, CommandAction& action) {
  auto options = std::make_shared<DemoOptions>();
  auto resolution_m = std::make_shared<double>(0);
  CLI::App* command =
      app.add_subcommand("demo", "Robots explore a world, all in software; map and report");
  add_run_options(*command, {options->world, options->unknown_starts, options->model,
                             options->goals, options->localization, options->odometry_noise,
                             options->lidar_noise, options->until, options->time_limit_s,
                             options->visit_range_m, options->visit_fov_deg});
  add_process_options(*command, *options);
  command->add_option("--resolution", *resolution_m, "metres a pixel of a bare image")
      ->check(CLI::PositiveNumber);
  command
      ->add_option_function<std::vector<std::string>>(
          "--start",
          [options](const std::vector<std::string>& texts) {
            for (const std::string& text : texts) {
              options->world.starts.push_back(checked("--start", [&] { return parse_pose(text); }));
            }
          },
          "start pose x,y,heading in metres and degrees; once a robot")
      ->excludes("--random-starts");
  command->add_flag("--rough-starts", options->rough_starts,
                    "tell robots but the first start poses up to 0.5 m and 15 degrees wrong");
  command->add_option("--walkers", options->walkers, "people who cross the world")
      ->capture_default_str()
      ->check(CLI::Range(0, 50));
  command->add_option("--door", options->doors,
                      "as of ivfm sim, such as 3,1,3.1,2@20s+15s; repeatable");
  command->add_option("--fault", options->faults,
                      "as of ivfm sim, such as lidar-silence@12s+3s; repeatable");
  command->add_flag("--record-scans", options->record_scans,
                    "write what each lidar measured: robotN.recording");
  add_team_options(*command, *options);
  command->footer("Example: ivfm demo --robots 2 --world corridor --out out/demo");
  command->callback([options, resolution_m, &action] {
    action = [options, resolution_m] { return demonstrate(*options, *resolution_m); };
  });
}

}  // namespace ivfm::host

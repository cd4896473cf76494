#include "host/evaluation/eval_command.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

#include "host/cli/progress_line.h"
#include "host/cli/shipped_model.h"
#include "host/evaluation/calibration.h"
#include "host/evaluation/evaluator.h"
#include "host/evaluation/policies/exploration_policy.h"
#include "host/evaluation/report.h"
#include "host/simulator/world_catalog.h"

namespace ivfm::host {

namespace {

namespace fs = std::filesystem;

struct EvalOptions {
  WorldOptions world;
  EvaluationRequest request;
  std::string start;
  std::string episodes_out;
  bool json = false;
  bool no_timing = false;
  bool calibrate = false;
};

int run_calibration(const EvaluationRequest& request) {
  std::vector<CalibrationRow> rows;
  {
    ProgressLine progress(static_cast<std::uint64_t>(request.episodes), "episodes");
    rows = calibrate(request.episodes, request.seed,
                     [&](int done) { progress(static_cast<std::uint64_t>(done)); });
  }
  std::cout << to_text(rows);
  return 0;
}

int run_eval(EvalOptions& options) {
  EvaluationRequest& request = options.request;
  if (options.calibrate) return run_calibration(request);
  if (!options.start.empty()) options.world.start = parse_pose(options.start);
  request.world = make_world(options.world);
  const bool needs_model = request.policy == "qnet" || request.policy == "qnet-float";
  if (needs_model && request.model.empty()) {
    request.model = shipped_model(request.policy == "qnet" ? ".ivfm" : ".fnet").string();
  }
  make_policy(request.policy, request.world.config, request.model);  // complains early
  std::ofstream csv;
  if (!options.episodes_out.empty()) {
    csv.open(options.episodes_out);
    if (!csv) throw std::runtime_error("cannot write " + options.episodes_out);
  }
  EvaluationResult result;
  {
    ProgressLine progress(static_cast<std::uint64_t>(request.episodes), "episodes");
    result = evaluate(request, [&](int done) { progress(static_cast<std::uint64_t>(done)); });
  }
  std::cout << (options.json ? to_json(request, result, !options.no_timing)
                             : to_text(request, result));
  if (csv.is_open() && !(csv << to_csv(request, result)).flush()) {
    throw std::runtime_error("cannot write " + options.episodes_out);
  }
  return 0;
}

std::string policy_list() {
  std::string list = "who decides:";
  for (const std::string& name : policy_names()) list += " " + name;
  return list;
}

}  // namespace

void add_eval_command(CLI::App& app, CommandAction& action) {
  auto options = std::make_shared<EvalOptions>();
  EvaluationRequest& request = options->request;
  WorldOptions& world = options->world;
  request.threads = static_cast<int>(std::clamp(std::thread::hardware_concurrency(), 1u, 64u));
  CLI::App* command = app.add_subcommand("eval", "Judge a policy in a world, in process");
  command
      ->add_option("--world", world.name,
                   "1x, 2x, divider, divider-released, corridor, building, or a map file")
      ->capture_default_str();
  command->add_option("--policy", request.policy, policy_list())->capture_default_str();
  command->add_option("--model", request.model, "network of qnet (.ivfm) or qnet-float (.fnet)");
  command->add_option("--state", request.state, "ivfm (2 channels) or vfm (4), for the bandwidth")
      ->check(CLI::IsMember({"ivfm", "vfm"}))
      ->capture_default_str();
  command->add_option("--agents", request.agents, "how many robots")
      ->check(CLI::Range(1, 32))
      ->capture_default_str();
  command->add_option("--episodes", request.episodes, "how many")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  command->add_option("--seed", request.seed, "of everything random")->capture_default_str();
  command->add_option("--threads", request.threads, "the result does not depend on it")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  command->add_option("--resolution", world.resolution_m, "metres a cell, for a bare image");
  command->add_option("--until", world.until, "share of the area to explore, for maps [0.99]");
  command->add_option("--sensor-range", world.sensor_range_m, "metres, for maps [3]");
  command->add_option("--fov", world.fov_deg, "the lidar's field of view in degrees [360]");
  command->add_option("--start", options->start, "x,y,heading (m, m, degrees) of the first robot");
  command->add_flag("--walls-known", world.walls_known, "arenas: the border is known at the start");
  command->add_flag("--reroute", world.reroute,
                    "arenas: robots drive around what they see to block their way; without it they "
                    "drive into it, as in the paper's released code");
  command->add_flag("--count-last-view", world.count_last_view,
                    "arenas: an action's last view counts as a visit too");
  command->add_option("--episodes-out", options->episodes_out, "CSV file, a row an episode");
  command->add_flag("--json", options->json, "one JSON object");
  command->add_flag("--no-timing", options->no_timing, "decisions_per_s is null in the JSON");
  command->add_flag("--calibrate", options->calibrate,
                    "compare the 1x arena with the paper's released simulator, by its random "
                    "policy; takes --episodes and --seed");
  command->footer("Example: ivfm eval --world 1x --policy frontier-nearest --episodes 50 --json");
  command->callback([options, &action] { action = [options] { return run_eval(*options); }; });
}

}  // namespace ivfm::host

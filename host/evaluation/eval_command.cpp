#include "host/evaluation/eval_command.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "host/cli/progress_line.h"
#include "host/cli/shipped_model.h"
#include "host/evaluation/calibration.h"
#include "host/evaluation/comparison.h"
#include "host/evaluation/distribution_plot.h"
#include "host/evaluation/episode_story.h"
#include "host/evaluation/evaluator.h"
#include "host/evaluation/paper_document.h"
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
  std::vector<std::string> against;
  std::string episodes_out;
  std::string plot;
  std::string picture;
  std::optional<int> pictured_episode;
  std::string resume;
  bool json = false;
  bool no_timing = false;
  bool calibrate = false;
  bool paper = false;
  int compared_episodes = 1'000;
  std::string markdown;
  std::string commit = "unknown";
};

// The network of a policy that needs one: `given`, or the one that ships.
fs::path model_of(const std::string& policy, const fs::path& given) {
  if (policy != "qnet" && policy != "qnet-float") return {};
  if (!given.empty()) return given;
  return shipped_model(policy == "qnet" ? ".ivfm" : ".fnet");
}

// The judged policy and who else plays.
std::vector<Contestant> contestants_of(const EvalOptions& options) {
  const EvaluationRequest& r = options.request;
  std::vector<Contestant> all = {{r.policy, r.policy, model_of(r.policy, r.model), r.state}};
  for (const std::string& policy : options.against) {
    all.push_back({policy, policy, model_of(policy, {}), "ivfm"});
  }
  for (const Contestant& one : all) {
    make_policy(one.policy, options.request.world.config, one.model);  // complains early
  }
  return all;
}

// What is finished already, told to all processes.
EpisodeStore open_store(const EvalOptions& options, ProcessGroup& group) {
  EpisodeStore store;
  if (group.is_first() && !options.resume.empty()) store = EpisodeStore(options.resume);
  if (group.size() == 1) return store;
  std::string text;
  for (const std::string& line : store.lines()) text += line + '\n';
  std::istringstream lines(group.broadcast(text));
  if (group.is_first()) return store;
  for (std::string line; std::getline(lines, line);) store.add(line);
  return store;
}

void write_file(const std::string& path, const std::string& text) {
  std::ofstream out(path, std::ios::binary);
  if (!(out << text).flush()) throw std::runtime_error("cannot write " + path);
}

EvaluationRequest request_of(const EvalOptions& options, const Contestant& contestant) {
  EvaluationRequest request = options.request;
  request.policy = contestant.policy;
  request.model = contestant.model;
  request.state = contestant.state;
  return request;
}

std::vector<Outcome> play(const EvalOptions& options, ProcessGroup& group) {
  const std::vector<Contestant> contestants = contestants_of(options);
  const auto episodes = static_cast<std::uint64_t>(options.request.episodes);
  EpisodeStore store = open_store(options, group);
  ProgressLine progress(episodes * contestants.size(), "episodes");
  std::vector<Outcome> outcomes;
  for (const Contestant& one : contestants) {
    const auto report = [&](int finished) {
      progress(episodes * outcomes.size() + static_cast<std::uint64_t>(finished));
    };
    outcomes.push_back({one, evaluate(request_of(options, one), store, group, report)});
  }
  return outcomes;
}

void draw(const EvalOptions& options, const std::vector<Outcome>& outcomes) {
  const EvaluationRequest request = request_of(options, outcomes.front().contestant);
  const std::string world = request.world.name;
  if (!options.plot.empty()) {
    const std::string title = world + ", " + std::to_string(request.agents) + " agent(s)";
    write_file(options.plot, distribution_svg(title, outcomes));
  }
  if (options.picture.empty()) return;
  const int number =
      options.pictured_episode.value_or(median_episode(outcomes.front().result.episodes));
  const EpisodeStory story = tell_episode(request, number);
  const std::string title = request.policy + " in " + world + ", episode " + std::to_string(number);
  write_png(options.picture, draw_episode(story, title, 1'200));
  std::cerr << "episode " << number << ": " << explain(story) << '\n';
}

int judge(const EvalOptions& options, ProcessGroup& group) {
  if (!options.episodes_out.empty() && group.is_first()) write_file(options.episodes_out, "");
  const std::vector<Outcome> outcomes = play(options, group);
  if (!group.is_first()) return 0;
  const EvaluationRequest request = request_of(options, outcomes.front().contestant);
  const EvaluationResult& result = outcomes.front().result;
  std::cout << (options.json ? to_json(request, result, !options.no_timing)
                             : to_text(request, result));
  if (outcomes.size() > 1) {
    TextTable table = comparison_table();
    add_comparison(table, request.world.name, outcomes.front(), std::span(outcomes).subspan(1));
    (options.json ? std::cerr : std::cout) << "\n" << table.to_text();
  }
  if (!options.episodes_out.empty()) write_file(options.episodes_out, to_csv(request, result));
  draw(options, outcomes);
  return 0;
}

int judge_as_the_paper_does(EvalOptions& options, ProcessGroup& group) {
  if (options.against.empty()) options.against = baseline_names();
  PaperRequest request;
  request.contestants = contestants_of(options);
  request.episodes = options.request.episodes;
  request.compared_episodes = options.compared_episodes;
  request.seed = options.request.seed;
  request.threads = options.request.threads;
  EpisodeStore store = open_store(options, group);
  PaperOutcome outcome;
  {
    std::optional<ProgressLine> progress;
    outcome = evaluate_paper(request, store, group, [&](int finished, int wanted) {
      if (!progress) progress.emplace(static_cast<std::uint64_t>(wanted), "episodes");
      (*progress)(static_cast<std::uint64_t>(finished));
    });
  }
  if (!group.is_first()) return 0;
  std::cout << paper_text(outcome);
  if (!options.markdown.empty()) {
    write_paper_document(options.markdown, request, outcome, {options.commit, "make paper"});
  }
  return 0;
}

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
  if (options.calibrate) return run_calibration(options.request);
  const std::unique_ptr<ProcessGroup> group = join_process_group();
  try {
    if (options.request.threads == 0) {
      const unsigned cores = std::clamp(std::thread::hardware_concurrency(), 1u, 64u);
      options.request.threads = std::max(1, static_cast<int>(cores) / group->local_size());
    }
    if (!options.start.empty()) options.world.start = parse_pose(options.start);
    options.request.world = make_world(options.world);
    return options.paper ? judge_as_the_paper_does(options, *group) : judge(options, *group);
  } catch (const std::exception& error) {
    if (group->size() == 1) throw;
    std::cerr << "ivfm: process " << group->rank() << ": " << error.what() << '\n';
    group->abort();
    return 1;
  }
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
  request.threads = 0;
  CLI::App* command = app.add_subcommand("eval", "Judge a policy in a world, in process");
  command
      ->add_option("--world", world.name,
                   "1x, 2x, divider, divider-released, corridor, building, or a map file")
      ->capture_default_str();
  command->add_option("--policy", request.policy, policy_list())->capture_default_str();
  command->add_option("--model", request.model,
                      "network of qnet (.ivfm) or, for any kind of state, qnet-float (.fnet)");
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
  command
      ->add_option("--threads", request.threads,
                   "of this process; the result does not depend on it [all cores]")
      ->check(CLI::Range(1, 1024));
  command->add_option("--resolution", world.resolution_m, "metres a cell, for a bare image");
  command->add_option("--until", world.until, "share of the area to explore, for maps [0.99]");
  command->add_option("--sensor-range", world.sensor_range_m, "metres, for maps [3]");
  command->add_option("--visit-range", world.visit_range_m,
                      "metres within which a cell counts as seen, for maps [the sensor's]");
  command->add_option("--fov", world.fov_deg, "the lidar's field of view in degrees [360]");
  command->add_option("--visit-fov", world.visit_fov_deg, "and within so many degrees ahead");
  command->add_flag("--network-decides", world.network_decides,
                    "maps: the network alone chooses goals, as in arenas; without it views of "
                    "frontiers are weighed against its choice");
  command->add_option("--start", options->start, "x,y,heading (m, m, degrees) of the first robot");
  command->add_flag("--every-place", world.every_place,
                    "arenas: a target at every place at once; measures are means over all places "
                    "of what they were when each was found: a tenth of the noise");
  command->add_flag("--walls-known", world.walls_known, "arenas: the border is known at the start");
  command->add_flag("--reroute", world.reroute,
                    "arenas: robots drive around what they see to block their way; without it they "
                    "drive into it, as in the paper's released code");
  command->add_flag("--count-last-view", world.count_last_view,
                    "arenas: an action's last view counts as a visit too");
  command->add_option("--against", options->against,
                      "policies to play the same episodes: paired differences");
  command->add_option("--episodes-out", options->episodes_out, "CSV file, a row an episode");
  command->add_option("--resume", options->resume,
                      "file that keeps finished episodes; the same command goes on with it");
  command->add_option("--plot", options->plot, "SVG file: the distribution of the steps");
  command->add_option("--picture", options->picture,
                      "PNG file: an episode's paths over its visit map, and what it spent");
  command->add_option("--pictured-episode", options->pictured_episode,
                      "its number [of median cost]");
  command->add_flag("--json", options->json, "one JSON object");
  command->add_flag("--no-timing", options->no_timing, "decisions_per_s is null in the JSON");
  command->add_flag("--calibrate", options->calibrate,
                    "compare the 1x arena with the paper's released simulator, by its random "
                    "policy; takes --episodes and --seed");
  command->add_flag("--paper", options->paper,
                    "every row of the paper's tables beside ours, and the baselines; the world "
                    "and the number of agents follow from the table");
  command
      ->add_option("--compared-episodes", options->compared_episodes,
                   "--paper: of the paired comparison, a tenth in buildings; 0: none")
      ->check(CLI::Range(0, 1'000'000))
      ->capture_default_str();
  command->add_option("--markdown", options->markdown,
                      "--paper: writes this document, with plots and pictures beside it");
  command->add_option("--commit", options->commit, "--paper: named in the document");
  command->footer(
      "Example: ivfm eval --world 1x --policy frontier-nearest --episodes 50 --json\n"
      "         ivfm eval --paper --resume out/paper.csv\n"
      "         mpirun -n 2 ivfm eval --world 2x --agents 4");
  command->callback([options, &action] { action = [options] { return run_eval(*options); }; });
}

}  // namespace ivfm::host

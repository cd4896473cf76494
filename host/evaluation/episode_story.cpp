#include "host/evaluation/episode_story.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "host/evaluation/text_table.h"

namespace ivfm::host {

namespace {

constexpr double kNearM = 0.5;

double metres_between(Point a, Point b) {
  return std::sqrt(static_cast<double>(squared_distance_um2(a, b))) * 1e-6;
}

// What one action has to show not to be fruitless: a tenth of what a good one of the arena does.
constexpr std::uint32_t kFruitlessCells = 20;

PictureLayers layers_of(const ExplorationEnvironment& env) {
  PictureLayers layers{GridFrame(env.config().cell_um, env.extent()), {}, {}};
  layers.visits.assign(layers.frame.size(), 0);
  layers.obstacles.assign(layers.frame.size(), 0);
  for (int agent = 0; agent < env.agents(); ++agent) {
    const std::vector<std::uint8_t>& visits = env.visits(agent);
    const ExplorationMap& map = env.explorer(agent).map();
    for (std::size_t i = 0; i < layers.visits.size(); ++i) {
      layers.visits[i] = static_cast<std::uint16_t>(layers.visits[i] + visits[i]);
      const Cell cell = layers.frame.cell_of_index(i);
      if (map.frame().contains(cell) && map.is_obstacle(cell)) layers.obstacles[i] = 1;
    }
  }
  return layers;
}

std::string percent(double share) { return fixed(100 * share, 0) + " %"; }

std::vector<int> by_cost(std::span<const EpisodeMetrics> episodes) {
  std::vector<int> numbers(episodes.size());
  std::iota(numbers.begin(), numbers.end(), 0);
  std::ranges::stable_sort(numbers, [&](int a, int b) {
    const EpisodeMetrics& x = episodes[static_cast<std::size_t>(a)];
    const EpisodeMetrics& y = episodes[static_cast<std::size_t>(b)];
    return std::pair(x.found, -x.steps) < std::pair(y.found, -y.steps);
  });
  return numbers;
}

}  // namespace

EpisodeStory tell_episode(const EvaluationRequest& request, int episode) {
  EpisodeStory story;
  ExplorationEnvironment env(request.world.config);
  const auto policy = make_policy(request.policy, request.world.config, request.model);
  const auto agents = static_cast<std::size_t>(request.agents);
  for (std::size_t i = 0; i < agents; ++i) {
    story.robots.push_back({agents > 1 ? "robot " + std::to_string(i + 1) : "robot", {}});
  }
  env.set_observer([&](int agent, ExplorerCall call, const Pose& pose, Point, const Scan*, bool) {
    if (call != ExplorerCall::kFuse) return;
    story.robots[static_cast<std::size_t>(agent)].points.push_back(pose.position);
  });
  std::int64_t actions = 0;
  story.record =
      play_episode(request, env, *policy, episode,
                   [&](const ExplorationEnvironment& now, int agent, const StepResult& result) {
                     ++actions;
                     story.fruitless_actions += result.newly_seen_cells < kFruitlessCells ? 1 : 0;
                     const auto& target = now.scenario().target;
                     if (!target || story.first_near_action > 0) return;
                     const double metres = metres_between(now.pose(agent).position, *target);
                     if (metres < kNearM) story.first_near_action = actions;
                   });
  const Scenario& scenario = env.scenario();
  story.layers = layers_of(env);
  story.world = scenario.world;
  story.target = scenario.target;
  if (story.target) {
    story.start_to_target_m = 1e9;
    for (const Pose& start : scenario.starts) {
      story.start_to_target_m =
          std::min(story.start_to_target_m, metres_between(start.position, *story.target));
    }
  }
  const double cell_m = 1e-6 * env.config().cell_um;
  story.left_m2 =
      cell_m * cell_m *
      static_cast<double>(env.totals().explorable_cells - env.totals().explorable_seen_cells);
  return story;
}

std::string explain(const EpisodeStory& story) {
  const EpisodeMetrics& m = story.record.metrics;
  std::string text;
  if (story.target) {
    text = "Target " + fixed(story.start_to_target_m, 1) + " m from the start. ";
    if (m.coverage > 0.9) {
      text += "It lay in the last " + percent(1 - m.coverage) + " of the area";
    } else {
      text += percent(m.coverage) + " of the area was explored before";
    }
    if (!m.found) text += "; not found";
    if (story.first_near_action > 0 &&
        static_cast<double>(story.first_near_action) < m.steps * 0.75) {
      text += "; a robot came within " + fixed(kNearM, 1) + " m of it at action " +
              std::to_string(story.first_near_action) + " and did not look there";
    }
  } else {
    text = m.found ? "Complete" : fixed(story.left_m2, 1) + " m² were left";
  }
  text += ". Of " + fixed(m.steps, 0) + " actions " + fixed(m.collisions, 0) +
          " ended in contact and " + std::to_string(story.fruitless_actions) +
          " showed next to nothing new.";
  return text;
}

cv::Mat draw_episode(const EpisodeStory& story, const std::string& title, int width_px) {
  const EpisodeMetrics& m = story.record.metrics;
  PictureOptions options;
  options.title = title;
  options.subtitle = fixed(m.steps, 0) + " actions, " + fixed(m.distance_m, 1) + " m, RER " +
                     fixed(m.rer, 2) + ", " + percent(m.coverage) + " explored";
  options.world = story.world.get();
  options.width_px = width_px;
  std::vector<Trajectory> paths = story.robots;
  if (story.target) paths.push_back({"target", {*story.target}});
  return draw_map_picture(story.layers, paths, options);
}

std::vector<int> worst_episodes(std::span<const EpisodeMetrics> episodes, int count) {
  std::vector<int> numbers = by_cost(episodes);
  numbers.resize(std::min(numbers.size(), static_cast<std::size_t>(count)));
  return numbers;
}

int median_episode(std::span<const EpisodeMetrics> episodes) {
  return by_cost(episodes).at(episodes.size() / 2);
}

}  // namespace ivfm::host

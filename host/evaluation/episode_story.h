// One episode played again and looked at: its picture, and why it took long.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "host/evaluation/evaluator.h"
#include "host/log_analysis/map_picture.h"

namespace ivfm::host {

struct EpisodeStory {
  EpisodeRecord record;
  PictureLayers layers;            // what all robots saw and hold to be occupied
  std::vector<Trajectory> robots;  // one point a view
  std::shared_ptr<const World> world;
  std::optional<Point> target;

  double start_to_target_m = 0;  // of the nearest robot
  std::int64_t first_near_action =
      0;  // when a robot first came within half a metre of it; 0: never
  std::int64_t fruitless_actions = 0;  // showed fewer new cells than a hundredth of the area
  double left_m2 = 0;                  // explorable, not explored
};

EpisodeStory tell_episode(const EvaluationRequest& request, int episode);

// A sentence or two on where the actions went.
std::string explain(const EpisodeStory& story);

// The paths over the visit map. `width_px`: about this wide or high.
cv::Mat draw_episode(const EpisodeStory& story, const std::string& title, int width_px);

// The numbers of the `count` episodes that cost most, those without success first.
std::vector<int> worst_episodes(std::span<const EpisodeMetrics> episodes, int count);
// The number of an episode of median cost.
int median_episode(std::span<const EpisodeMetrics> episodes);

}  // namespace ivfm::host

#include "host/evaluation/comparison.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

namespace ivfm::host {

namespace {

double mean_of(std::span<const EpisodeMetrics> episodes, double (*of)(const EpisodeMetrics&)) {
  double sum = 0;
  for (const EpisodeMetrics& episode : episodes) sum += of(episode);
  return sum / static_cast<double>(episodes.size());
}

}  // namespace

double PairedDifference::in_standard_errors() const {
  if (standard_error > 0) return mean / standard_error;
  return mean == 0 ? 0 : std::copysign(std::numeric_limits<double>::infinity(), mean);
}

PairedDifference paired_difference(std::span<const EpisodeMetrics> ours,
                                   std::span<const EpisodeMetrics> theirs,
                                   double (*of)(const EpisodeMetrics&)) {
  std::vector<double> differences;
  for (std::size_t i = 0; i < ours.size() && ours.size() == theirs.size(); ++i) {
    if (ours[i].seed != theirs[i].seed) break;
    differences.push_back(of(theirs[i]) - of(ours[i]));
  }
  if (differences.empty() || differences.size() != ours.size()) {
    throw std::invalid_argument("the policies did not play the same episodes");
  }
  const MeanStd all = mean_std(differences);
  const auto n = static_cast<double>(all.count);
  return {all.mean, n > 1 ? all.std / std::sqrt(n - 1) : 0};
}

double steps_of(const EpisodeMetrics& episode) { return episode.steps; }
double metres_of(const EpisodeMetrics& episode) { return episode.distance_m; }

std::int64_t not_found(std::span<const EpisodeMetrics> episodes) {
  return std::ranges::count_if(episodes, [](const EpisodeMetrics& e) { return !e.found; });
}

TextTable comparison_table() {
  return {{"world", "opponent", "episodes", "our steps", "its steps", "difference", "in SE",
           "our m", "its m", "difference", "in SE", "not found: ours, its"},
          {}};
}

void add_comparison(TextTable& table, const std::string& world, const Outcome& ours,
                    std::span<const Outcome> theirs) {
  const std::span<const EpisodeMetrics> own = ours.result.episodes;
  for (const Outcome& other : theirs) {
    const std::span<const EpisodeMetrics> its = other.result.episodes;
    TextTable::Row row = {{world}, {other.contestant.label}, {std::to_string(own.size())}};
    for (const auto of : {steps_of, metres_of}) {
      const PairedDifference d = paired_difference(own, its, of);
      const bool is_better = d.in_standard_errors() > 2;
      row.push_back({fixed(mean_of(own, of), 2)});
      row.push_back({fixed(mean_of(its, of), 2)});
      row.push_back({with_error(d.mean, d.standard_error, 2), false, is_better});
      row.push_back({fixed(d.in_standard_errors(), 1), false, is_better});
    }
    row.push_back({std::to_string(not_found(own)) + ", " + std::to_string(not_found(its))});
    table.rows.push_back(std::move(row));
  }
}

}  // namespace ivfm::host

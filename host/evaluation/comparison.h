// One policy against others on the same episodes: paired differences and their standard errors.
#pragma once

#include <span>
#include <string>

#include "host/evaluation/evaluator.h"
#include "host/evaluation/text_table.h"

namespace ivfm::host {

// A policy that takes part, and how it is called in tables.
struct Contestant {
  std::string label;
  std::string policy;
  std::filesystem::path model;  // empty for policies without one
  std::string state = "ivfm";
};

struct Outcome {
  Contestant contestant;
  EvaluationResult result;
};

struct PairedDifference {
  double mean = 0;            // theirs - ours: positive when ours is smaller
  double standard_error = 0;  // of the mean, from the differences episode by episode
  // Infinite for a difference without any spread.
  double in_standard_errors() const;
};

// The differences over all episodes, those without success included, with what they spent until
// then. Both must hold the same episodes; throws std::invalid_argument when they do not.
PairedDifference paired_difference(std::span<const EpisodeMetrics> ours,
                                   std::span<const EpisodeMetrics> theirs,
                                   double (*of)(const EpisodeMetrics&));

double steps_of(const EpisodeMetrics& episode);
double metres_of(const EpisodeMetrics& episode);

// The header of the table and a row for each opponent; a difference of more than two standard
// errors in our favour is marked as better.
TextTable comparison_table();
void add_comparison(TextTable& table, const std::string& world, const Outcome& ours,
                    std::span<const Outcome> theirs);

std::int64_t not_found(std::span<const EpisodeMetrics> episodes);

}  // namespace ivfm::host

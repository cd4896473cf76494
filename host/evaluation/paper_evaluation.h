// Every row of the paper's tables beside ours, and the learned policy against the baselines.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "host/evaluation/comparison.h"
#include "host/evaluation/paper_tables.h"

namespace ivfm::host {

struct PaperRequest {
  std::vector<Contestant> contestants;  // the first is the one that is judged
  int episodes = kPaperEpisodes;        // a row
  int compared_episodes = 1'000;        // of the paired comparison, one agent, a tenth in buildings
  std::uint64_t seed = 1;
  int threads = 1;
};

struct SettingOutcome {
  const PaperSetting* paper = nullptr;
  std::vector<Outcome> ours;
};

struct WorldOutcome {
  std::string world;
  std::vector<Outcome> ours;
};

struct PaperOutcome {
  std::vector<SettingOutcome> settings;
  std::vector<WorldOutcome> compared;
};

// One row's request.
EvaluationRequest request_for(const PaperRequest& paper, const std::string& world, int agents,
                              const Contestant& contestant, int episodes);

// `progress`: with the episodes finished and wanted. The first process of `group` answers the
// outcome, the others an empty one. Throws as evaluate().
PaperOutcome evaluate_paper(const PaperRequest& request, EpisodeStore& store, ProcessGroup& group,
                            const std::function<void(int, int)>& progress = {});

// Our rows of one setting under the paper's. Where both of the paper's learned policies have a
// figure, the better one is marked as the best, and ours where it is better still.
TextTable setting_table(std::span<const SettingOutcome> settings, const std::string& table);

// The tables of the paper in its order, without repetition.
std::vector<std::string> paper_table_names();

}  // namespace ivfm::host

// The paper's three tables of results, as data (paper.tex; method.md, "The paper's results").
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace ivfm::host {

struct PaperValue {
  double mean = 0;
  double std = 0;
};

struct PaperRow {
  std::string policy;
  PaperValue rer, pe, steps;
  std::optional<PaperValue> overlap;
  std::optional<PaperValue> bandwidth_mib;
  PaperValue coverage;
  std::optional<int> not_found;  // of kPaperEpisodes
  bool is_learned = true;        // VFM or i-VFM
  // The released baseline's distance leaves out the last leg of many moves (method.md,
  // "Calibration"): its PE cannot be compared.
  bool pe_is_artefact = false;
};

inline constexpr int kPaperEpisodes = 200;

// One world and team size of the paper, with every row that the paper gives for it.
struct PaperSetting {
  std::string table;
  std::string world;
  int agents = 1;
  std::vector<PaperRow> rows;
};

std::span<const PaperSetting> paper_settings();

}  // namespace ivfm::host

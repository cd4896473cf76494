// Why a run was slow: what its data say, in sentences, the most expensive first.
#pragma once

#include <string>
#include <vector>

#include "host/log_analysis/run_data.h"

namespace ivfm::host {

struct Finding {
  double cost_s = 0;     // robot time that it cost, about; orders the list
  std::string headline;  // a sentence
  std::string detail;    // where, when, what to do; may be empty
};

// Empty when nothing cost a twentieth of the fleet's time.
std::vector<Finding> find_reasons(const RunData& run);

}  // namespace ivfm::host

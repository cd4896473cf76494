// Two runs side by side.
#pragma once

#include <string>

#include "host/log_analysis/run_data.h"

namespace ivfm::host {

// A table of the figures of both and their difference, and what cost time in each.
std::string compare_as_text(const RunData& a, const RunData& b);
// The same as an object: {"a": figures, "b": figures}, as of metrics_json().
std::string compare_as_json(const RunData& a, const RunData& b);
// The same as a page, with both runs' curves in one chart.
std::string compare_as_html(const RunData& a, const RunData& b);

// The figures of a run as a JSON object. What the run's own judge reported stands there as he did.
std::string metrics_json(const RunData& run);
// The same as a table for people.
std::string metrics_text(const RunData& run);

}  // namespace ivfm::host

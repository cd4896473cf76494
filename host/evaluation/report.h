// An evaluation as text, JSON (interfaces.md) and CSV.
#pragma once

#include <string>

#include "host/evaluation/evaluator.h"

namespace ivfm::host {

// One object, ending in a newline. Everything but decisions_per_s depends on the request alone;
// with `with_timing` false that is null and so the same request gives the same bytes.
std::string to_json(const EvaluationRequest& request, const EvaluationResult& result,
                    bool with_timing);
// A header and a row an episode.
std::string to_csv(const EvaluationRequest& request, const EvaluationResult& result);
// A small table for people.
std::string to_text(const EvaluationRequest& request, const EvaluationResult& result);

}  // namespace ivfm::host

#include "host/evaluation/report.h"

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <nlohmann/json.hpp>

namespace ivfm::host {

namespace {

using Json = nlohmann::ordered_json;

std::int64_t not_found(const EvaluationResult& result) {
  return std::count_if(result.episodes.begin(), result.episodes.end(),
                       [](const EpisodeMetrics& e) { return !e.found; });
}

double decisions_per_s(const EvaluationResult& result) {
  return result.busy_s > 0 ? static_cast<double>(result.decisions) / result.busy_s : 0;
}

// Null when no episode has a value.
Json summary(const NamedMetric& metric, const EvaluationResult& result) {
  const MeanStd value = summarized(metric, result.episodes);
  if (value.count == 0) return nullptr;
  return {{"mean", value.mean}, {"std", value.std}};
}

// The shortest text that reads back as the same number; empty for none.
std::string number(const std::optional<double>& value) {
  if (!value) return {};
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, *value);
  return {text, end.ptr};
}

std::string row(const char* name, const MeanStd& value) {
  char line[96];
  if (value.count == 0) {
    std::snprintf(line, sizeof line, "  %-20s      none\n", name);
  } else {
    std::snprintf(line, sizeof line, "  %-20s %9.3f ± %.3f\n", name, value.mean, value.std);
  }
  return line;
}

}  // namespace

std::string to_json(const EvaluationRequest& request, const EvaluationResult& result,
                    bool with_timing) {
  Json json = {{"world", request.world.name},   {"policy", request.policy},
               {"state", request.state},        {"agents", request.agents},
               {"episodes", request.episodes},  {"seed", request.seed},
               {"not_found", not_found(result)}};
  json["decisions_per_s"] = with_timing ? Json(decisions_per_s(result)) : Json(nullptr);
  json["local_map_width_m"] = local_map_width_m(request.world.config);
  for (const NamedMetric& metric : metrics()) json[metric.name] = summary(metric, result);
  if (request.world.is_map) {
    for (const NamedMetric& metric : milestone_metrics()) {
      json[metric.name] = summary(metric, result);
    }
    json["completed"] = request.episodes - not_found(result);
  }
  return json.dump(2) + "\n";
}

std::string to_csv(const EvaluationRequest& request, const EvaluationResult& result) {
  std::string csv = "episode,seed,found";
  const auto for_each = [&](const auto& visit) {
    for (const NamedMetric& metric : metrics()) visit(metric);
    if (!request.world.is_map) return;
    for (const NamedMetric& metric : milestone_metrics()) visit(metric);
  };
  for_each([&](const NamedMetric& metric) { (csv += ',') += metric.name; });
  csv += "\n";
  for (std::size_t i = 0; i < result.episodes.size(); ++i) {
    const EpisodeMetrics& episode = result.episodes[i];
    ((csv += std::to_string(i)) += ',') += std::to_string(episode.seed);
    csv += episode.found ? ",1" : ",0";
    for_each([&](const NamedMetric& metric) { (csv += ',') += number(metric.of(episode)); });
    csv += "\n";
  }
  return csv;
}

std::string to_text(const EvaluationRequest& request, const EvaluationResult& result) {
  std::string text = request.policy + " in " + request.world.name + ", " +
                     std::to_string(request.agents) + " agent(s), " +
                     std::to_string(request.episodes) + " episodes (mean ± std over found ones)\n";
  for (const NamedMetric& metric : metrics()) {
    text += row(metric.name, summarized(metric, result.episodes));
  }
  if (request.world.is_map) {
    for (const NamedMetric& metric : milestone_metrics()) {
      text += row(metric.name, summarized(metric, result.episodes));
    }
  }
  char line[96];
  std::snprintf(line, sizeof line, "  %-20s %5lld of %d\n  %-20s %9.0f\n", "not found",
                static_cast<long long>(not_found(result)), request.episodes, "decisions/s",
                decisions_per_s(result));
  return text + line;
}

}  // namespace ivfm::host

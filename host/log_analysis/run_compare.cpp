#include "host/log_analysis/run_compare.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "host/cli/progress_line.h"
#include "host/log_analysis/findings.h"
#include "host/log_analysis/run_report.h"
#include "host/log_analysis/svg_chart.h"

namespace ivfm::host {
namespace {

using Json = nlohmann::ordered_json;

// One figure of a run; nothing when it is not known.
struct NamedFigure {
  const char* name;
  const char* unit;
  std::optional<double> value;
};

// When the run had seen `share` of what it saw in the end.
std::optional<double> time_of_share(const RunData& run, double share) {
  if (run.explored_m2.empty()) return std::nullopt;
  for (const auto& [time_s, area] : run.explored_m2) {
    if (area >= share * run.explored_m2.back().second) return time_s;
  }
  return std::nullopt;
}

std::optional<double> outcome(const RunData& run, const char* key) {
  const auto found = run.outcome.find(key);
  return found == run.outcome.end() ? std::nullopt : std::optional(found->second);
}

double lost_time(const RunData& run) {
  double total = 0;
  for (const RobotRun& robot : run.robots) {
    for (const Span& span : robot.spans) {
      const bool useful = span.activity == Activity::kDriving ||
                          span.activity == Activity::kTurning || span.activity == Activity::kDone;
      total += useful ? 0 : span.length_s();
    }
  }
  return total;
}

double median_decision_ms(const RunData& run) {
  std::vector<float> all;
  for (const RobotRun& robot : run.robots) {
    all.insert(all.end(), robot.decisions_ms.begin(), robot.decisions_ms.end());
  }
  if (all.empty()) return 0;
  const auto middle = all.begin() + static_cast<std::ptrdiff_t>((all.size() - 1) / 2);
  std::nth_element(all.begin(), middle, all.end());
  return static_cast<double>(*middle);
}

std::vector<NamedFigure> figures_of(const RunData& run) {
  const PoseErrors errors = over_all(run.pose_errors);
  const auto if_known = [&errors](double value) {
    return errors.poses == 0 ? std::nullopt : std::optional(value);
  };
  const auto if_a_mission = [&run](double value) {
    return run.recorded ? std::nullopt : std::optional(value);
  };
  return {{"time_s", "s", run.time_s},
          {"explored_m2", "m²", run.scores.explored_m2},
          {"coverage", "", outcome(run, "coverage")},
          {"driven_m", "m", run.judged("driven_m", run.driven_m)},
          {"steps", "", static_cast<double>(run.actions())},
          {"rer", "", run.scores.repeat_rate},
          {"pe", "px/m", run.scores.pixels_per_metre},
          {"overlap", "", if_a_mission(run.scores.overlap)},
          {"collisions", "", outcome(run, "collisions")},
          {"bandwidth_paper_mib", "MiB", if_a_mission(run.paper_bytes() / 1048576)},
          {"wire_bytes", "B", if_a_mission(static_cast<double>(run.wire_bytes()))},
          {"decision_ms", "ms", if_a_mission(median_decision_ms(run))},
          {"seen_half_after_s", "s", time_of_share(run, 0.5)},
          {"seen_90_percent_after_s", "s", time_of_share(run, 0.9)},
          {"lost_robot_time_s", "s", lost_time(run)},
          {"position_error_rms_m", "m", if_known(errors.rms_m)},
          {"position_error_largest_m", "m", if_known(errors.largest_m)},
          {"heading_error_rms_deg", "°", if_known(errors.rms_deg)},
          {"heading_error_largest_deg", "°", if_known(errors.largest_deg)}};
}

std::string number(std::optional<double> value) {
  if (!value) return "–";
  char text[32];
  std::snprintf(text, sizeof text, std::abs(*value) >= 1000 ? "%.0f" : "%.3f", *value);
  return text;
}

std::string change(std::optional<double> a, std::optional<double> b) {
  if (!a || !b || *a == 0) return "";
  char text[32];
  std::snprintf(text, sizeof text, "%+.1f %%", (*b - *a) / std::abs(*a) * 100);
  return text;
}

Json to_json(const RunData& run) {
  Json json{{"run", run.name},
            {"cell_m", run.cell_m},
            {"explored_cells", run.explored_cells},
            {"obstacle_cells", run.obstacle_cells}};
  for (const NamedFigure& figure : figures_of(run)) {
    json[figure.name] = figure.value ? Json(*figure.value) : Json(nullptr);
  }
  json["reported"] = Json::object();
  for (const auto& [key, value] : run.outcome) json["reported"][key] = value;
  json["robots"] = Json::array();
  for (const RobotRun& robot : run.robots) {
    const float slowest = robot.decisions_ms.empty() ? 0
                                                     : *std::max_element(robot.decisions_ms.begin(),
                                                                         robot.decisions_ms.end());
    json["robots"].push_back({{"robot", robot.robot},
                              {"name", robot.name},
                              {"state", robot.last_state},
                              {"driven_m", robot.driven_m},
                              {"actions", robot.actions},
                              {"slowest_decision_ms", slowest},
                              {"retransmissions", robot.retransmissions},
                              {"lost", robot.lost},
                              {"bytes_in", robot.traffic.bytes_in},
                              {"bytes_out", robot.traffic.bytes_out},
                              {"visit_bytes", robot.traffic.layers[0].bytes},
                              {"obstacle_bytes", robot.traffic.layers[1].bytes}});
  }
  for (Json& robot : json["robots"]) {
    const auto found = run.pose_errors.find(robot["robot"].get<std::uint16_t>());
    if (found == run.pose_errors.end()) continue;
    robot["position_error_rms_m"] = found->second.rms_m;
    robot["position_error_largest_m"] = found->second.largest_m;
    robot["heading_error_rms_deg"] = found->second.rms_deg;
    robot["heading_error_largest_deg"] = found->second.largest_deg;
  }
  json["warnings"] = run.warnings;
  return json;
}

// `text` and spaces up to `width` characters of UTF-8; behind it, or before it.
std::string padded(const std::string& text, std::size_t width, bool right) {
  const auto length = static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xc0) != 0x80; }));
  const std::string space(width > length ? width - length : 0, ' ');
  return right ? space + text : text + space;
}

std::string reasons_text(const RunData& run) {
  std::string text = "\nWhat cost time in " + run.name + ":\n";
  const std::vector<Finding> findings = find_reasons(run);
  if (findings.empty()) text += "  nothing worth telling\n";
  for (const Finding& finding : findings) text += "  " + finding.headline + "\n";
  return text;
}

std::vector<std::vector<std::string>> rows_of(const RunData& a, const RunData& b) {
  std::vector<std::vector<std::string>> rows;
  const auto of_a = figures_of(a), of_b = figures_of(b);
  for (std::size_t i = 0; i < of_a.size(); ++i) {
    rows.push_back({of_a[i].name, of_a[i].unit, number(of_a[i].value), number(of_b[i].value),
                    change(of_a[i].value, of_b[i].value)});
  }
  return rows;
}

}  // namespace

std::string metrics_json(const RunData& run) { return to_json(run).dump(2); }

std::string metrics_text(const RunData& run) {
  std::string text;
  for (const NamedFigure& figure : figures_of(run)) {
    text += padded(figure.name, 26, false) + padded(number(figure.value), 14, true) + " " +
            figure.unit + "\n";
  }
  return text + reasons_text(run);
}

std::string compare_as_text(const RunData& a, const RunData& b) {
  const std::size_t width = std::max({std::size_t{14}, a.name.size() + 2, b.name.size() + 2});
  std::string text = padded("", 32, false) + padded(a.name, width, true) +
                     padded(b.name, width, true) + padded("change", 12, true) + "\n";
  for (const auto& row : rows_of(a, b)) {
    text += padded(row[0], 26, false) + padded(row[1], 6, false) + padded(row[2], width, true) +
            padded(row[3], width, true) + padded(row[4], 12, true) + "\n";
  }
  return text + reasons_text(a) + reasons_text(b);
}

std::string compare_as_json(const RunData& a, const RunData& b) {
  return Json{{"a", to_json(a)}, {"b", to_json(b)}}.dump(2);
}

std::string compare_as_html(const RunData& a, const RunData& b) {
  const std::string title = a.name + " and " + b.name;
  std::string html =
      "<h1>" + html_escaped(title) + "</h1><p class=\"faint\">" +
      html_escaped(a.name + ": " + describe(a) + ". " + b.name + ": " + describe(b)) +
      ".</p><h2>Figures</h2>" +
      html_table({"figure", "unit", a.name, b.name, "change"}, rows_of(a, b));
  const double end_s = std::max(a.time_s, b.time_s);
  html += "<h2>Explored over time</h2><div class=\"frame\">" +
          render_chart({"Explored area over time", "s", "m²", end_s, 0, 0, "", 1130},
                       {{a.name, robot_colour(0), thinned(a.explored_m2, 700)},
                        {b.name, robot_colour(2), thinned(b.explored_m2, 700)}}) +
          "</div>";
  for (const RunData* run : {&a, &b}) {
    html += "<h2>What cost time in " + html_escaped(run->name) + "</h2><ul>";
    const std::vector<Finding> findings = find_reasons(*run);
    if (findings.empty()) html += "<li>nothing worth telling</li>";
    for (const Finding& finding : findings) {
      html += "<li>" + html_escaped(finding.headline + " " + finding.detail) + "</li>";
    }
    html += "</ul>";
  }
  return html_page(title, html);
}

}  // namespace ivfm::host

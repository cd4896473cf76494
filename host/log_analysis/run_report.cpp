#include "host/log_analysis/run_report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>

#include "host/cli/progress_line.h"
#include "host/log_analysis/findings.h"
#include "host/log_analysis/svg_chart.h"

namespace ivfm::host {
namespace {

constexpr std::size_t kMostEvents = 200;
constexpr std::size_t kMostGoalsDrawn = 400;
constexpr std::size_t kCurvePoints = 700;

constexpr const char* kStyle = R"css(
:root{--ink:#1f2933;--faint:#66707c;--line:#dfe3e8;--soft:#f6f7f9;--ground:#fff;--good:#1b7f5c;--bad:#c2255c}
@media (prefers-color-scheme:dark){:root{--ink:#e7eaee;--faint:#a3adb8;--line:#343c46;--soft:#1d232a;--ground:#14181d;--good:#41ae8a;--bad:#ff7a9c}}
*{box-sizing:border-box}
body{margin:0;background:var(--ground);color:var(--ink);font:16px/1.5 system-ui,"DejaVu Sans",sans-serif}
main{max-width:1180px;margin:0 auto;padding:40px 24px 64px}
h1{font-size:30px;line-height:1.2;margin:0 0 4px}h2{font-size:19px;margin:40px 0 12px}
p{margin:0 0 12px}.faint{color:var(--faint)}
.verdicts{display:flex;flex-wrap:wrap;gap:8px;margin:20px 0}
.verdict{border:1px solid;border-radius:99px;padding:3px 14px;font-weight:600;font-size:14px}
.good{color:var(--good)}.bad{color:var(--bad)}
.warning{border-left:4px solid var(--bad);padding:6px 14px;background:var(--soft)}
ol.reasons{margin:0;padding-left:24px}ol.reasons li{margin-bottom:12px}ol.reasons b{display:block}
.figures{display:grid;grid-template-columns:repeat(auto-fill,minmax(170px,1fr));gap:12px}
.figure{background:var(--soft);border-radius:10px;padding:14px 16px}
.figure b{display:block;font-size:24px;line-height:1.25;font-weight:650}
.figure span{display:block}.figure small{color:var(--faint)}
img,svg{display:block;width:100%;height:auto}
.chart{font-size:13px}.chart text{fill:var(--faint)}.chart .grid{stroke:var(--line)}
.chart .mark{stroke:#d9480f;stroke-dasharray:6 5}
.legend{display:flex;flex-wrap:wrap;gap:4px 18px;font-size:14px;margin:8px 0 0}
.legend i{display:inline-block;width:11px;height:11px;border-radius:3px;margin-right:7px}
.frame{border:1px solid var(--line);border-radius:10px;overflow:hidden;padding:12px}
.wide{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
th,td{padding:8px 12px;border-bottom:1px solid var(--line);text-align:right;white-space:nowrap}
th{color:var(--faint);font-weight:500;white-space:normal;vertical-align:bottom}th:first-child,td:first-child{text-align:left}
code,pre{font:14px/1.5 ui-monospace,"DejaVu Sans Mono",monospace}
pre{background:var(--soft);border-radius:10px;padding:14px 16px;overflow-x:auto;margin:0}
dl{display:grid;grid-template-columns:max-content 1fr;gap:4px 20px;margin:0}dd{margin:0}
)css";

// One colour an Activity.
constexpr std::array<const char*, kActivities> kActivityColours{
    "#1b7f5c", "#99d8c9", "#e9a23b", "#d9480f", "#9c36b5",
    "#c2255c", "#b4bcc6", "#66707c", "#4c8dd6", "#1f2933"};

std::string text_of(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

// One decimal of small numbers, none of large ones.
std::string size_of(double value, const char* unit) {
  return text_of(value < 1000 ? "%.1f " : "%.0f ", value) + unit;
}

std::string kib(double bytes) {
  return bytes < 1e6 ? text_of("%.1f KiB", bytes / 1024) : text_of("%.2f MiB", bytes / 1048576);
}

// RFC 4648, section 4.
std::string base64(const std::vector<std::uint8_t>& bytes) {
  constexpr char kAlphabet[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      group = group << 8 | (i + k < bytes.size() ? bytes[i + k] : 0u);
    }
    for (std::size_t k = 0; k < 4; ++k) {
      out += i + k > bytes.size() ? '=' : kAlphabet[group >> (18 - 6 * k) & 63];
    }
  }
  return out;
}

std::string section(const std::string& title, const std::string& body) {
  return "\n<h2>" + html_escaped(title) + "</h2>" + body;
}

std::string framed(const std::string& body) { return "<div class=\"frame\">" + body + "</div>"; }

double quantile(std::vector<float> values, double share) {
  if (values.empty()) return 0;
  const auto at = static_cast<std::size_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(at), values.end());
  return static_cast<double>(values[at]);
}

std::vector<float> all_decisions(const RunData& run) {
  std::vector<float> all;
  for (const RobotRun& robot : run.robots) {
    all.insert(all.end(), robot.decisions_ms.begin(), robot.decisions_ms.end());
  }
  return all;
}

std::string render_reasons(const RunData& run) {
  const std::vector<Finding> findings = find_reasons(run);
  if (findings.empty()) {
    return "<p>Nothing cost more than a twentieth of the robots' time: they were driving, and what "
           "they drove through was new.</p>";
  }
  std::string html = "<ol class=\"reasons\">";
  for (const Finding& finding : findings) {
    html += "<li><b>" + html_escaped(finding.headline) + "</b><span class=\"faint\">" +
            html_escaped(finding.detail) + "</span></li>";
  }
  return html + "</ol>";
}

std::string render_figures(const RunData& run) {
  struct Figure {
    std::string value, label, note;
  };
  std::vector<Figure> figures{
      {size_of(run.scores.explored_m2, "m²"), "explored",
       run.outcome.contains("coverage")
           ? text_of("%.1f %% of what can be seen", run.scores.coverage * 100)
           : std::to_string(run.explored_cells) + " cells"},
      {duration_text(run.time_s), "run time",
       run.recorded ? "from the first scan to the last" : "on the server's clock"},
      {size_of(run.judged("driven_m", run.driven_m), "m"), "driven",
       run.outcome.contains("driven_m") ? "all robots, true distance" : "all robots, by odometry"},
      {std::to_string(run.actions()), "actions",
       run.recorded ? "of ten scans" : "goals driven to"}};
  std::string html = "<div class=\"figures\">";
  for (const Figure& figure : figures) {
    html += "<div class=\"figure\"><b>" + html_escaped(figure.value) + "</b><span>" +
            html_escaped(figure.label) + "</span><small>" + html_escaped(figure.note) +
            "</small></div>";
  }
  return html + "</div>";
}

std::string render_drive_metrics(const RunData& run) {
  return html_table({"RER", "PE", "steps"}, {{text_of("%.3f", run.scores.repeat_rate),
                                              text_of("%.0f", run.scores.pixels_per_metre),
                                              std::to_string(run.actions())}}) +
         "<p class=\"faint\">RER: repeated visits a cell. PE: pixels of 1/128 m seen a metre "
         "driven. Steps: actions of ten scans; crosses in the map are the goals that the robot's "
         "planner would have chosen after each, without a policy. Nobody drove there.</p>";
}

std::string render_metrics(const RunData& run) {
  const std::vector<float> decisions = all_decisions(run);
  return html_table(
             {"robots", "RER", "PE", "steps", "overlap", "coverage", "bandwidth, paper's formula",
              "bandwidth, on the wire", "decision, median", "collisions"},
             {{std::to_string(run.robots.size()), text_of("%.3f", run.scores.repeat_rate),
               text_of("%.0f", run.scores.pixels_per_metre), std::to_string(run.actions()),
               text_of("%.3f", run.scores.overlap),
               run.outcome.contains("coverage") ? text_of("%.3f", run.scores.coverage) : "–",
               kib(run.paper_bytes()), kib(static_cast<double>(run.wire_bytes())),
               text_of("%.1f ms", quantile(decisions, 0.5)),
               run.outcome.contains("collisions") ? text_of("%.0f", run.judged("collisions", 0))
                                                  : "–"}}) +
         "<p class=\"faint\">RER: repeated visits a cell. PE: pixels of 1/128 m seen a metre "
         "driven. Steps: goals driven to. Paper's formula: two channels of 128 x 128 uint16 and "
         "two "
         "poses an action, and a byte for every cell of the rectangles that the robots sent. Wire: "
         "every byte in both directions, headers and acknowledgements included.</p>";
}

std::vector<BarKind> activity_kinds() {
  std::vector<BarKind> kinds;
  for (std::size_t i = 0; i < kActivities; ++i) {
    kinds.push_back({to_string(static_cast<Activity>(i)), kActivityColours[i]});
  }
  return kinds;
}

std::string span_text(const Span& span) {
  std::string text = text_of("%.1f s", span.begin_s) + " to " + text_of("%.1f s", span.end_s) +
                     ": " + to_string(span.activity);
  if (span.blocker) text += " (robot " + std::to_string(*span.blocker) + ")";
  const std::string causes = fault_text(span.causes);
  return causes.empty() ? text : text + " (" + causes + ")";
}

std::string render_time(const RunData& run) {
  std::vector<Bar> bars;
  std::vector<Lane> lanes;
  for (const RobotRun& robot : run.robots) {
    Bar bar{robot.name, {}};
    for (std::size_t i = 0; i < kActivities; ++i) {
      bar.parts.push_back(robot.time_in(static_cast<Activity>(i)));
    }
    bars.push_back(bar);
    Lane lane{robot.name, {}};
    for (const Span& span : robot.spans) {
      lane.spans.push_back(
          {span.begin_s, span.end_s, static_cast<std::size_t>(span.activity), span_text(span)});
    }
    lanes.push_back(lane);
  }
  ChartAxes sums{"What each robot spent its time on", "s", "", 0, 0, 0, "", 1130};
  ChartAxes line{"What each robot did when, faults included", "s", "", run.time_s, 0, 0, "", 1130};
  return framed(render_lying_bars(sums, activity_kinds(), bars)) +
         section("What happened when", framed(render_lanes(line, activity_kinds(), lanes)));
}

std::string render_coverage(const RunData& run, double goal) {
  const Curve curve = thinned(run.explored_m2, kCurvePoints);
  ChartAxes axes{"Explored area over time", "s", "m²", run.time_s, 0, 0, "", 1130};
  const double explorable = run.judged("explorable_m2", 0);
  if (explorable > 0 && goal > 0) {
    axes.mark_y = goal * explorable;
    axes.mark = "goal: " + text_of("%g %%", goal * 100);
  }
  std::string html = framed(render_chart(axes, {{"", "#1b7f5c", curve, false, true}}));
  Curve over_metres;
  for (const auto& [time_s, area] : curve) {
    double metres = 0;
    for (const RobotRun& robot : run.robots) metres += value_at(robot.driven, time_s);
    if (over_metres.empty() || metres > over_metres.back().first) {
      over_metres.emplace_back(metres, area);
    } else {
      over_metres.back().second = area;
    }
  }
  axes.title = "Explored area over metres driven by all robots";
  axes.x_unit = "m";
  axes.x_end = 0;
  return html + section("Explored over metres driven",
                        framed(render_chart(axes, {{"", "#1971c2", over_metres, false, true}})));
}

std::string render_visits(const RunData& run) {
  std::vector<Bar> bars;
  for (std::size_t i = 0; i < run.visits_m2.size(); ++i) {
    const int most = std::min(255, 1 << i), least = (1 << i) / 2 + 1;
    const std::string text = std::to_string(most);
    bars.push_back(
        {least == most ? text : std::to_string(least) + " to " + text, {run.visits_m2[i]}});
  }
  return framed(render_bars({"Area by the number of visits", "", "m²", 0, 0, 0, "", 1130},
                            {{"visits", "#41ae8a"}}, bars)) +
         "<p class=\"faint\">How often each place was visited, all robots together; one visit an "
         "action.</p>";
}

std::string render_traffic(const RunData& run) {
  const std::vector<BarKind> kinds{{"visits, from the robot", "#1b7f5c"},
                                   {"obstacles, from the robot", "#d9480f"},
                                   {"poses, status, acknowledgements, headers", "#b4bcc6"},
                                   {"to the robot", "#4c8dd6"}};
  std::vector<Bar> bars;
  std::vector<ChartSeries> rates;
  for (std::size_t i = 0; i < run.robots.size(); ++i) {
    const TrafficCounters& traffic = run.robots[i].traffic;
    const auto visits = static_cast<double>(traffic.layers[0].bytes) / 1024;
    const auto obstacles = static_cast<double>(traffic.layers[1].bytes) / 1024;
    const auto in = static_cast<double>(traffic.bytes_in) / 1024;
    bars.push_back({run.robots[i].name,
                    {visits, obstacles, std::max(0.0, in - visits - obstacles),
                     static_cast<double>(traffic.bytes_out) / 1024}});
    rates.push_back(
        {run.robots[i].name, robot_colour(i), thinned(run.robots[i].kib_per_s, kCurvePoints)});
  }
  return framed(render_lying_bars(
             {"Radio traffic of each robot by layer", "KiB", "", 0, 0, 0, "", 1130}, kinds, bars)) +
         section("Radio traffic over time",
                 framed(render_chart(
                     {"Radio traffic of each robot", "s", "KiB/s", run.time_s, 0, 0, "", 1130},
                     rates)));
}

std::string render_decisions(const RunData& run) {
  const std::vector<float> all = all_decisions(run);
  std::vector<ChartSeries> series;
  for (std::size_t i = 0; i < run.robots.size(); ++i) {
    series.push_back({run.robots[i].name, robot_colour(i),
                      thinned(run.robots[i].decisions, kCurvePoints), true, false});
  }
  return framed(render_chart({"Time of each decision", "s", "ms", run.time_s, 0, 0, "", 1130},
                             series)) +
         "<p class=\"faint\">" + std::to_string(all.size()) + " of " +
         std::to_string(run.actions()) + " decisions were told: median " +
         text_of("%.1f ms", quantile(all, 0.5)) + ", 95 % below " +
         text_of("%.1f ms", quantile(all, 0.95)) + ", slowest " +
         text_of("%.1f ms", quantile(all, 1)) + " of the robot's processor.</p>";
}

// Position and heading errors of each robot, where somebody knew the truth.
std::string render_pose_errors(const RunData& run) {
  std::vector<ChartSeries> position, heading;
  std::vector<std::vector<std::string>> rows;
  for (std::size_t i = 0; i < run.robots.size(); ++i) {
    const auto found = run.pose_errors.find(run.robots[i].robot);
    if (found == run.pose_errors.end()) continue;
    const PoseErrors& errors = found->second;
    position.push_back({run.robots[i].name, robot_colour(i), errors.position_m});
    heading.push_back({run.robots[i].name, robot_colour(i), errors.heading_deg});
    rows.push_back({run.robots[i].name, text_of("%.3f m", errors.rms_m),
                    text_of("%.3f m", errors.largest_m), text_of("%.2f°", errors.rms_deg),
                    text_of("%.2f°", errors.largest_deg), std::to_string(errors.poses),
                    text_of("%.0f ms", errors.delay_s * 1e3)});
  }
  return framed(render_chart({"Distance between where each robot believed to be and where it was",
                              "s", "m", run.time_s, 0, 0, "", 1130},
                             position)) +
         "<p></p>" +
         framed(render_chart(
             {"Error of each robot's heading", "s", "°", run.time_s, 0, 0, "", 1130}, heading)) +
         html_table({"robot", "position, rms", "largest", "heading, rms", "largest", "poses",
                     "came late by"},
                    rows) +
         "<p class=\"faint\">The poses that the robots told, against the true ones at the moment "
         "that they are of. On the wire a pose has 11 bits: 16 mm at 16 to 32 m, 0.1°.</p>";
}

std::string render_robots(const RunData& run) {
  std::vector<std::vector<std::string>> rows;
  for (const RobotRun& robot : run.robots) {
    rows.push_back({robot.name, text_of("%.1f m", robot.driven_m), std::to_string(robot.actions),
                    std::to_string(robot.starts), robot.last_state,
                    kib(static_cast<double>(robot.traffic.bytes_in)),
                    kib(static_cast<double>(robot.traffic.bytes_out)),
                    text_of("%.1f %%", robot.lost * 100), std::to_string(robot.retransmissions),
                    text_of("%.1f ms", quantile(robot.decisions_ms, 1))});
  }
  return html_table({"robot", "driven", "actions", "starts", "state at the end", "from robot",
                     "to robot", "lost on the way", "sent again", "slowest decision"},
                    rows);
}

std::string render_events(const std::vector<TimelineEntry>& entries) {
  std::string html = "<dl>";
  for (std::size_t i = 0; i < std::min(entries.size(), kMostEvents); ++i) {
    const TimelineEntry& entry = entries[i];
    const std::string who = entry.robot ? "robot " + std::to_string(*entry.robot) + ": " : "";
    html += "<dt><code>" + text_of("%.1f s", entry.time_s) + "</code></dt><dd>" +
            html_escaped(who + entry.text) + "</dd>";
  }
  if (entries.size() > kMostEvents) {
    html += "<dt>...</dt><dd>" + std::to_string(entries.size() - kMostEvents) +
            " more: <code>ivfm log timeline</code></dd>";
  }
  return html + "</dl>";
}

std::string render_head(const RunData& run, const ReportExtras& extras, const std::string& title) {
  std::string html = "<h1>" + html_escaped(title) + "</h1><p class=\"faint\">" +
                     html_escaped(extras.subtitle.empty() ? describe(run) + "." : extras.subtitle) +
                     "</p>\n<div class=\"verdicts\">";
  for (const Verdict& verdict : extras.verdicts) {
    html += std::string("<span class=\"verdict ") + (verdict.good ? "good\">✓ " : "bad\">✗ ") +
            html_escaped(verdict.text) + "</span>";
  }
  html += "</div>";
  for (const std::string& warning : run.warnings) {
    html += "<p class=\"warning\">" + html_escaped(warning) + "</p>";
  }
  return html;
}

}  // namespace

std::string describe(const RunData& run) {
  return std::to_string(run.robots.size()) + (run.robots.size() == 1 ? " robot, " : " robots, ") +
         duration_text(run.time_s) + text_of(", %.1f m² explored, ", run.scores.explored_m2) +
         text_of("%.1f m driven", run.driven_m);
}

cv::Mat draw_run(const RunData& run) {
  if (run.explored_cells + run.obstacle_cells == 0) {
    throw std::runtime_error("run database '" + run.name + "' holds no map: no robot has sent one");
  }
  PictureOptions picture;
  picture.title = run.name;
  picture.subtitle = describe(run);
  std::vector<Trajectory> trajectories = trajectories_of(run);
  for (Trajectory& trajectory : trajectories) {
    if (trajectory.goals.size() > kMostGoalsDrawn) trajectory.goals.clear();
  }
  return draw_map_picture(to_picture_layers(run.map), trajectories, picture);
}

std::string html_page(const std::string& title, const std::string& body) {
  return "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
         "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><title>" +
         html_escaped(title) + "</title><style>" + kStyle + "</style></head><body><main>\n" + body +
         "</main></body></html>\n";
}

std::string html_table(const std::vector<std::string>& head,
                       const std::vector<std::vector<std::string>>& rows) {
  std::string html = "<div class=\"wide\"><table><thead><tr>";
  for (const std::string& text : head) html += "<th>" + html_escaped(text) + "</th>";
  html += "</tr></thead><tbody>";
  for (const auto& row : rows) {
    html += "<tr>";
    for (const std::string& text : row) html += "<td>" + html_escaped(text) + "</td>";
    html += "</tr>";
  }
  return html + "</tbody></table></div>";
}

std::string html_picture(const cv::Mat& picture, const std::string& description) {
  std::vector<std::uint8_t> png;
  cv::imencode(".png", picture, png, {cv::IMWRITE_PNG_COMPRESSION, 6});
  return "<img alt=\"" + html_escaped(description) + "\" src=\"data:image/png;base64," +
         base64(png) + "\">";
}

std::string render_run_report(const RunData& run, const std::vector<TimelineEntry>& timeline,
                              const cv::Mat& map, const ReportExtras& extras) {
  const std::string title = extras.title.empty() ? "Run " + run.name : extras.title;
  std::string html = render_head(run, extras, title) + render_figures(run);
  html += section("What cost time", render_reasons(run));
  html += section("Metrics", run.recorded ? render_drive_metrics(run) : render_metrics(run));
  if (!map.empty()) {
    html += section("Map", framed(html_picture(
                               map, "Merged map: visits, obstacles, the robots' paths and goals")));
  }
  html += section("Where the time went", render_time(run));
  html += section("Explored over time", render_coverage(run, extras.goal));
  html += section("Visits", render_visits(run));
  if (!run.recorded) html += section("Radio traffic", render_traffic(run));
  if (!run.recorded) html += section("Decisions", render_decisions(run));
  if (!run.pose_errors.empty()) html += section("Where they were", render_pose_errors(run));
  if (!run.recorded) html += section("Robots", render_robots(run));
  if (!timeline.empty()) html += section("Events", render_events(timeline));
  if (!extras.files.empty()) {
    std::string list = "<dl>";
    for (const auto& [name, what] : extras.files) {
      list += "<dt><code>" + html_escaped(name) + "</code></dt><dd>" + html_escaped(what) + "</dd>";
    }
    html += section("Files", list + "</dl>");
  }
  if (!extras.command.empty()) {
    html += section("Run it again", "<pre>" + html_escaped(extras.command) + "</pre>");
  }
  return html_page(title, html);
}

}  // namespace ivfm::host

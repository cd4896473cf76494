// The three forms of a CanReport: text, JSON and a page.
#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <numbers>

#include "firmware/wheel_drive/cia402.h"
#include "host/can_analysis/can_analysis.h"
#include "host/cli/progress_line.h"
#include "host/log_analysis/run_report.h"
#include "host/log_analysis/svg_chart.h"

namespace ivfm::host {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMostEventsShown = 12, kMostEventsOnPage = 30, kCurvePoints = 1000;

std::string text_of(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string state_name(std::size_t state) {
  return cia402::to_string(static_cast<cia402::State>(state));
}

std::vector<BarKind> state_kinds() {
  constexpr std::array<const char*, cia402::kStateCount> kColours{
      "#b4bcc6", "#66707c", "#99d8c9", "#41ae8a", "#1b7f5c", "#e9a23b", "#d9480f", "#c2255c"};
  std::vector<BarKind> kinds;
  for (std::size_t i = 0; i < cia402::kStateCount; ++i)
    kinds.push_back({state_name(i), kColours[i]});
  return kinds;
}

double time_in(const DriveTrace& drive, cia402::State state) {
  double total = 0;
  for (const CanStateSpan& span : drive.states) {
    if (span.state == static_cast<std::size_t>(state)) total += span.end_s - span.begin_s;
  }
  return total;
}

void add_events(std::string& text, const char* title, const std::vector<CanEvent>& events,
                std::uint64_t count) {
  text += std::string("  ") + title + ": " + std::to_string(count) + "\n";
  for (std::size_t i = 0; i < std::min(kMostEventsShown, events.size()); ++i) {
    text +=
        text_of("    %9.3f s  ", events[i].time_s) + events[i].who + ": " + events[i].text + "\n";
  }
  if (count > kMostEventsShown) text += "    ... --json lists more\n";
}

std::string bus_text(const BusReport& bus, const WheelScale& scale) {
  std::string text = bus.bus + ": " + std::to_string(bus.frames) + " frames in " +
                     duration_text(bus.length_s) +
                     text_of(", %.1f kbit/s", bus.load_bits_per_s / 1e3) + "\n";
  for (const DriveTrace& drive : bus.drives) {
    text +=
        "  " + drive.name + ": " +
        (drive.states.empty() ? "no state" : "'" + state_name(drive.states.back().state) + "'") +
        " at the end, enabled for " +
        duration_text(time_in(drive, cia402::State::kOperationEnabled)) +
        text_of(", fastest %.3f m/s\n", drive.fastest * scale.metres_per_count());
  }
  for (const ProtocolTiming& timing : bus.timings) {
    text += "  " + timing.what + text_of(": every %.1f ms", timing.period_s * 1e3) +
            text_of(", longest gap %.1f ms, ", timing.longest_gap_s * 1e3) +
            std::to_string(timing.late) + " late, " + std::to_string(timing.missed) + " missed\n";
  }
  add_events(text, "faults and refusals", bus.faults, bus.fault_count);
  add_events(text, "violations of the protocol", bus.violations, bus.violation_count);
  return text;
}

Json events_json(const std::vector<CanEvent>& events) {
  Json json = Json::array();
  for (const CanEvent& event : events) {
    json.push_back({{"time_s", event.time_s}, {"who", event.who}, {"what", event.text}});
  }
  return json;
}

Json bus_json(const BusReport& bus, const WheelScale& scale) {
  Json json{{"bus", bus.bus},
            {"frames", bus.frames},
            {"length_s", bus.length_s},
            {"load_bits_per_s", bus.load_bits_per_s},
            {"frames_by_message", bus.frames_by_message}};
  for (const DriveTrace& drive : bus.drives) {
    Json states = Json::array();
    for (const CanStateSpan& span : drive.states) {
      states.push_back({{"begin_s", span.begin_s}, {"state", state_name(span.state)}});
    }
    json["drives"].push_back({{"name", drive.name},
                              {"nmt_state", drive.nmt_state},
                              {"fastest_m_per_s", drive.fastest * scale.metres_per_count()},
                              {"states", states}});
  }
  for (const ProtocolTiming& timing : bus.timings) {
    json["timings"].push_back({{"what", timing.what},
                               {"frames", timing.frames},
                               {"period_s", timing.period_s},
                               {"longest_gap_s", timing.longest_gap_s},
                               {"late", timing.late},
                               {"missed", timing.missed}});
  }
  json["fault_count"] = bus.fault_count;
  json["faults"] = events_json(bus.faults);
  json["violation_count"] = bus.violation_count;
  json["violations"] = events_json(bus.violations);
  return json;
}

ChartSeries speed_series(const std::string& name, const std::string& colour,
                         std::vector<std::pair<double, double>> points, double scale) {
  const std::size_t step = points.size() / kCurvePoints + 1;
  ChartSeries series{name, colour, {}};
  for (std::size_t i = 0; i < points.size(); i += step) {
    series.points.emplace_back(points[i].first, points[i].second * scale);
  }
  return series;
}

std::string speeds_html(const BusReport& bus, const WheelScale& scale) {
  std::vector<ChartSeries> series;
  for (std::size_t i = 0; i < bus.drives.size(); ++i) {
    const DriveTrace& drive = bus.drives[i];
    series.push_back(speed_series(drive.name + ", wanted", i % 2 == 0 ? "#f0b79f" : "#c3b5ee",
                                  drive.target, scale.metres_per_count()));
    series.push_back(speed_series(drive.name + ", measured", robot_colour(i), drive.actual,
                                  scale.metres_per_count()));
  }
  return "<div class=\"frame\">" +
         render_chart({"Wheel speeds", "s", "m/s", bus.length_s, 0, 0, "", 1130}, series) +
         "</div>";
}

std::string states_html(const BusReport& bus) {
  std::vector<Lane> lanes;
  for (const DriveTrace& drive : bus.drives) {
    Lane lane{drive.name, {}};
    for (std::size_t i = 0; i < drive.states.size(); ++i) {
      const CanStateSpan& span = drive.states[i];
      // A state lasts until the next is seen.
      const double end_s = i + 1 < drive.states.size() ? drive.states[i + 1].begin_s : span.end_s;
      lane.spans.push_back({span.begin_s, end_s, span.state,
                            text_of("%.3f s: ", span.begin_s) + state_name(span.state)});
    }
    lanes.push_back(lane);
  }
  return "<div class=\"frame\">" +
         render_lanes({"States of the drives", "s", "", bus.length_s, 0, 0, "", 1130},
                      state_kinds(), lanes) +
         "</div>";
}

std::string events_html(const std::vector<CanEvent>& events, std::uint64_t count) {
  if (events.empty()) return "<p>None.</p>";
  std::string html = "<dl>";
  for (std::size_t i = 0; i < std::min(kMostEventsOnPage, events.size()); ++i) {
    html += "<dt><code>" + text_of("%.3f s", events[i].time_s) + "</code></dt><dd>" +
            html_escaped(events[i].who + ": " + events[i].text) + "</dd>";
  }
  html += "</dl>";
  if (count > kMostEventsOnPage) {
    html += "<p class=\"faint\">" + std::to_string(count) + " in all.</p>";
  }
  return html;
}

std::string bus_html(const BusReport& bus, const WheelScale& scale) {
  std::vector<std::vector<std::string>> timings;
  for (const ProtocolTiming& t : bus.timings) {
    timings.push_back({t.what, std::to_string(t.frames), text_of("%.1f ms", t.period_s * 1e3),
                       text_of("%.1f ms", t.longest_gap_s * 1e3), std::to_string(t.late),
                       std::to_string(t.missed)});
  }
  std::vector<std::vector<std::string>> counts;
  for (const auto& [name, count] : bus.frames_by_message) {
    counts.push_back({name, std::to_string(count)});
  }
  return "<h2>Bus " + html_escaped(bus.bus) + "</h2><p class=\"faint\">" +
         std::to_string(bus.frames) + " frames in " + duration_text(bus.length_s) +
         text_of(", %.1f kbit/s.", bus.load_bits_per_s / 1e3) + "</p>" + speeds_html(bus, scale) +
         "<h2>States of the drives</h2>" + states_html(bus) + "<h2>Faults and refusals</h2>" +
         events_html(bus.faults, bus.fault_count) + "<h2>Violations of the protocol</h2>" +
         events_html(bus.violations, bus.violation_count) + "<h2>Timing</h2>" +
         html_table({"what", "frames", "period", "longest gap", "late", "missed"}, timings) +
         "<h2>Frames</h2>" + html_table({"message", "frames"}, counts);
}

}  // namespace

double WheelScale::metres_per_count() const {
  return 2 * std::numbers::pi * radius_m / counts_per_turn;
}

std::string can_report_text(const CanReport& report, const WheelScale& scale) {
  std::string text = std::to_string(report.counters.frames) + " frames";
  if (report.counters.malformed > 0) {
    text += ", " + std::to_string(report.counters.malformed) + " other lines";
  }
  text += "\n";
  for (const BusReport& bus : report.buses) text += "\n" + bus_text(bus, scale);
  return text;
}

std::string can_report_json(const CanReport& report, const WheelScale& scale) {
  Json json{{"frames", report.counters.frames},
            {"malformed_lines", report.counters.malformed},
            {"buses", Json::array()}};
  for (const BusReport& bus : report.buses) json["buses"].push_back(bus_json(bus, scale));
  return json.dump(2) + "\n";
}

std::string can_report_html(const std::string& title, const CanReport& report,
                            const WheelScale& scale) {
  std::string html = "<h1>" + html_escaped(title) + "</h1><p class=\"faint\">" +
                     std::to_string(report.counters.frames) + " CAN frames, " +
                     std::to_string(report.counters.malformed) + " other lines.</p>";
  for (const BusReport& bus : report.buses) html += bus_html(bus, scale);
  return html_page(title, html);
}

}  // namespace ivfm::host

#include "host/log_analysis/findings.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "firmware/supervisor/supervisor.h"
#include "host/cli/progress_line.h"

namespace ivfm::host {
namespace {

constexpr double kWorthTelling = 0.05;  // of a robot's time
constexpr double kShortS = 3;           // a stretch as at every start and end
constexpr double kLossWorthTelling = 0.05;
constexpr std::size_t kMostSpansNamed = 3;

std::string text_of(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string percent(double share) { return text_of("%.0f %%", share * 100); }

// A robot's time with a task: from its first message to its last, but not when it was done.
double task_time(const RobotRun& robot) {
  double total = 0;
  for (const Span& span : robot.spans) {
    total += span.activity == Activity::kDone ? 0 : span.length_s();
  }
  return total;
}

std::vector<Span> spans_of(const RobotRun& robot, Activity activity) {
  std::vector<Span> spans;
  for (const Span& span : robot.spans) {
    if (span.activity == activity) spans.push_back(span);
  }
  std::stable_sort(spans.begin(), spans.end(),
                   [](const Span& a, const Span& b) { return a.length_s() > b.length_s(); });
  return spans;
}

// "most of it from 12 s to 80 s, from 90 s to 95 s".
std::string longest(std::vector<Span> spans) {
  const std::size_t all = spans.size();
  spans.resize(std::min(spans.size(), kMostSpansNamed));
  std::stable_sort(spans.begin(), spans.end(),
                   [](const Span& a, const Span& b) { return a.begin_s < b.begin_s; });
  std::string text = all > spans.size() ? "Longest" : "When";
  const char* separator = ": ";
  for (const Span& span : spans) {
    text += separator + text_of("%.0f s", span.begin_s) + " to " + text_of("%.0f s", span.end_s);
    separator = ", ";
  }
  if (all > spans.size()) text += "; " + std::to_string(all) + " times in all";
  return text + ".";
}

std::string causes_of(const std::vector<Span>& spans) {
  unsigned causes = 0;
  for (const Span& span : spans) causes |= span.causes;
  return fault_text(static_cast<std::uint8_t>(causes));
}

// One kind of lost time of one robot.
void add_lost_time(const RobotRun& robot, Activity activity, const std::string& what,
                   const std::string& advice, std::vector<Finding>& findings) {
  const double time_s = robot.time_in(activity), all_s = task_time(robot);
  if (time_s < kShortS || time_s < kWorthTelling * all_s) return;
  findings.push_back({time_s,
                      robot.name + " " + what + " for " + duration_text(time_s) + ", " +
                          percent(time_s / all_s) + " of its time.",
                      longest(spans_of(robot, activity)) + " " + advice});
}

std::string name_of(const RunData& run, std::uint16_t id) {
  for (const RobotRun& robot : run.robots) {
    if (robot.robot == id) return robot.name;
  }
  return "robot " + std::to_string(id);
}

void add_blockers(const RunData& run, std::vector<Finding>& findings) {
  for (const RobotRun& robot : run.robots) {
    std::map<std::uint16_t, std::vector<Span>> by_blocker;
    for (const Span& span : spans_of(robot, Activity::kHeldByRobot)) {
      by_blocker[*span.blocker].push_back(span);
    }
    for (const auto& [blocker, spans] : by_blocker) {
      double time_s = 0;
      for (const Span& span : spans) time_s += span.length_s();
      if (time_s < kShortS || time_s < kWorthTelling * task_time(robot)) continue;
      findings.push_back(
          {time_s,
           robot.name + " stood less than " + text_of("%g m", kNearM) + " from " +
               name_of(run, blocker) + " for " + duration_text(time_s) + ", " +
               percent(time_s / task_time(robot)) + " of its time: they were in each other's way.",
           longest(spans) +
               " Start robots farther apart, or where there is room to pass each other."});
    }
  }
}

void add_faults(const RobotRun& robot, std::vector<Finding>& findings) {
  const std::string causes = causes_of(spans_of(robot, Activity::kFault));
  add_lost_time(robot, Activity::kFault,
                "was in fault" + (causes.empty() ? "" : " (" + causes + ")"),
                "docs/safety.md says what ends a fault.", findings);
}

void add_radio(const RunData& run, const RobotRun& robot, std::vector<Finding>& findings) {
  const double unheard_s = robot.time_in(Activity::kUnheard);
  if (robot.lost < kLossWorthTelling && unheard_s < kWorthTelling * run.time_s) return;
  std::string headline = robot.name + "'s radio lost " + percent(robot.lost) + " of what it sent";
  if (unheard_s > 0) headline += ", and nothing was heard of it for " + duration_text(unheard_s);
  std::string detail = std::to_string(robot.retransmissions) + " rectangles were sent again. ";
  const auto silent = spans_of(robot, Activity::kUnheard);
  if (!silent.empty()) detail += longest(silent) + " ";
  if (run.scores.overlap > kWorthTelling) {
    detail += "Robots that do not hear of each other explore the same places: " +
              percent(run.scores.overlap) + " of the cells were seen by two or more.";
  }
  // Robots drive on with a bad radio: what it costs is the area that is explored twice.
  const double cost_s = unheard_s + robot.lost * run.time_s;
  findings.push_back({cost_s, headline + ".", detail});
}

// The longest stretch in which much was driven and nearly nothing new was seen.
void add_idle_driving(const RunData& run, std::vector<Finding>& findings) {
  if (run.explored_m2.size() < 3 || run.driven_m <= 0) return;
  const auto driven_at = [&](double time_s) {
    double total = 0;
    for (const RobotRun& robot : run.robots) total += value_at(robot.driven, time_s);
    return total;
  };
  const double usual = run.explored_m2.back().second / run.driven_m;  // m2 per metre
  double best_m = 0, begin_s = 0, end_s = 0, gained_m2 = 0;
  for (std::size_t i = 0, k = 0; i < run.explored_m2.size(); ++i) {
    // From i on, as long as what is gained stays below a fifth of what is usual.
    k = std::max(k, i + 1);
    const double metres_at_i = driven_at(run.explored_m2[i].first);
    for (; k < run.explored_m2.size(); ++k) {
      const double metres = driven_at(run.explored_m2[k].first) - metres_at_i;
      const double area = run.explored_m2[k].second - run.explored_m2[i].second;
      if (metres > 0 && area > usual / 5 * metres) break;
      if (metres > best_m) {
        best_m = metres;
        begin_s = run.explored_m2[i].first;
        end_s = run.explored_m2[k].first;
        gained_m2 = area;
      }
    }
  }
  if (best_m < std::max(1.0, 0.1 * run.driven_m)) return;
  // Of a robot that was not heard nobody knows when it drove what it told later.
  for (const RobotRun& robot : run.robots) {
    for (const Span& span : spans_of(robot, Activity::kUnheard)) {
      if (span.begin_s < end_s && span.end_s > begin_s) return;
    }
  }
  // It cost the time of those that drove, less what the new area was worth.
  const auto drove = std::count_if(run.robots.begin(), run.robots.end(), [&](const RobotRun& one) {
    return value_at(one.driven, end_s) - value_at(one.driven, begin_s) > 0.1;
  });
  const double wasted = 1 - gained_m2 / usual / best_m;
  findings.push_back(
      {(end_s - begin_s) * static_cast<double>(drove) * wasted,
       "From " + text_of("%.0f s", begin_s) + " to " + text_of("%.0f s", end_s) +
           " the robots drove " + text_of("%.1f m", best_m) + " and saw only " +
           text_of("%.1f m²", gained_m2) + " that was new.",
       "Over the whole run it was " + text_of("%.2f m²", usual) +
           " a metre. They drove through what was known already, to frontiers far away."});
}

double length_of(const std::vector<Span>& spans) {
  double total_s = 0;
  for (const Span& span : spans) total_s += span.length_s();
  return total_s;
}

// Known only where a judge knew the world.
bool is_incomplete(const RunData& run) {
  return run.outcome.contains("coverage") && run.scores.coverage < 1 - 2 * kWorthTelling;
}

void add_giving_up(const RunData& run, const RobotRun& robot, const std::vector<Span>& spans,
                   double later_m2, std::vector<Finding>& findings) {
  const auto first = std::min_element(spans.begin(), spans.end(), [](const Span& a, const Span& b) {
    return a.begin_s < b.begin_s;
  });
  const auto blocked = std::find_if(spans.begin(), spans.end(),
                                    [](const Span& span) { return span.blocker.has_value(); });
  std::string headline = robot.name + " gave up after " + text_of("%.0f s", first->begin_s) +
                         " and " + text_of("%.1f m", value_at(robot.driven, first->begin_s)) +
                         " driven and was idle for " + duration_text(length_of(spans)) +
                         ": it found no way on";
  std::string detail = longest(spans) + " There was more: ";
  if (is_incomplete(run)) {
    detail += "in the end " + percent(run.scores.coverage) + " of what can be seen was seen. ";
  } else {
    detail += text_of("%.1f m²", later_m2) + " were found after that, " +
              percent(later_m2 / run.explored_m2.back().second) + " of all. ";
  }
  if (blocked != spans.end()) {
    const std::string blocker = name_of(run, *blocked->blocker);
    headline += ", because " + blocker + " was in its way";
    detail += blocker + " was less than " + text_of("%g m", kInWayM) +
              " away when it gave up. Start robots farther apart, or where there is room to pass "
              "each other.";
  } else {
    detail +=
        "No other robot was near: it was shut in, or held for walls what were none. The map "
        "shows where it stands.";
  }
  findings.push_back({length_of(spans), headline + ".", detail});
}

// A robot that called its work done before the others.
void add_early_end(const RunData& run, const RobotRun& robot, std::vector<Finding>& findings) {
  const double all_m2 = run.explored_m2.empty() ? 0 : run.explored_m2.back().second;
  std::vector<Span> given_up, done;
  double later_m2 = 0, heard_s = 0;
  for (const Span& span : robot.spans) heard_s += span.length_s();
  for (const Span& span : spans_of(robot, Activity::kDone)) {
    const double later = all_m2 - value_at(run.explored_m2, span.begin_s);
    const bool shut_off = span.blocker && is_incomplete(run);  // both may have given up for good
    (later > kWorthTelling * all_m2 || shut_off ? given_up : done).push_back(span);
    later_m2 = std::max(later_m2, later);
  }
  if (length_of(given_up) > std::max(kShortS, kWorthTelling * heard_s)) {
    add_giving_up(run, robot, given_up, later_m2, findings);
  }
  if (length_of(done) < 0.2 * run.time_s) return;
  findings.push_back(
      {length_of(done),
       robot.name + " had nothing left to explore for " + duration_text(length_of(done)) + ".",
       longest(done) + " By then the robots had seen nearly all that was seen in this run."});
}

void add_decisions(const RobotRun& robot, std::vector<Finding>& findings) {
  double total_s = 0;
  for (const float ms : robot.decisions_ms) total_s += static_cast<double>(ms) / 1e3;
  if (total_s < kWorthTelling * task_time(robot) || total_s <= 0) return;
  findings.push_back({total_s,
                      robot.name + " spent " + duration_text(total_s) + " deciding, " +
                          percent(total_s / task_time(robot)) + " of its time.",
                      "The processor is slow or busy with something else."});
}

}  // namespace

std::vector<Finding> find_reasons(const RunData& run) {
  std::vector<Finding> findings;
  for (const RobotRun& robot : run.robots) {
    if (run.recorded) {
      add_lost_time(robot, Activity::kStanding, "stood still", "A recording does not say why.",
                    findings);
      add_lost_time(robot, Activity::kUnheard, "recorded no scan", "", findings);
      continue;
    }
    add_faults(robot, findings);
    add_lost_time(robot, Activity::kHeldByObstacle, "was held by an obstacle",
                  "Its way was blocked closer than its stopping distance; the map shows where.",
                  findings);
    add_lost_time(robot, Activity::kStanding, "stood still without a fault",
                  "It had a mission, but no way that it could drive; the map shows where.",
                  findings);
    add_lost_time(robot, Activity::kStopped, "was stopped by a command",
                  "A person or the server said stop.", findings);
    add_lost_time(robot, Activity::kWaiting, "waited for its lidar, its drives or a mission", "",
                  findings);
    add_radio(run, robot, findings);
    add_early_end(run, robot, findings);
    add_decisions(robot, findings);
  }
  add_blockers(run, findings);
  add_idle_driving(run, findings);
  std::stable_sort(findings.begin(), findings.end(),
                   [](const Finding& a, const Finding& b) { return a.cost_s > b.cost_s; });
  return findings;
}

}  // namespace ivfm::host

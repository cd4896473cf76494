#include "host/map_server/server_metrics.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <initializer_list>
#include <sstream>
#include <utility>

namespace ivfm::host {
namespace {

std::string text_of(double value) {
  std::ostringstream out;
  out.precision(15);
  out << value;
  return out.str();
}

class MetricsText {
 public:
  void head(const std::string& name, const char* type, const std::string& help) {
    text_ += "# HELP " + name + " " + help + "\n# TYPE " + name + " " + type + "\n";
  }
  void sample(const std::string& name, double value) {
    text_ += name + " " + text_of(value) + "\n";
  }
  void metric(const std::string& name, const char* type, const std::string& help, double value) {
    head(name, type, help);
    sample(name, value);
  }
  // One sample a label value.
  void metric(const std::string& name, const char* type, const std::string& help,
              const std::string& label,
              std::initializer_list<std::pair<const char*, std::uint64_t>> samples) {
    head(name, type, help);
    for (const auto& [value, count] : samples) {
      sample(name + "{" + label + "=\"" + value + "\"}", static_cast<double>(count));
    }
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

void add_traffic(MetricsText& out, const MapServerCounters& counters) {
  const TrafficCounters& traffic = counters.traffic;
  out.metric("ivfm_radio_datagrams_total", "counter", "Datagrams from and to the robots.",
             "direction", {{"in", traffic.datagrams_in}, {"out", traffic.datagrams_out}});
  out.metric("ivfm_radio_bytes_total", "counter", "Their bytes, IP and UDP headers included.",
             "direction", {{"in", traffic.bytes_in}, {"out", traffic.bytes_out}});
  out.metric("ivfm_radio_dropped_total", "counter", "Datagrams that were not taken, and why.",
             "reason",
             {{"malformed", counters.dropped_malformed},
              {"unknown", counters.dropped_unknown},
              {"refused", counters.dropped_refused},
              {"replayed", counters.dropped_replayed},
              {"stale", counters.dropped_stale},
              {"cell_size", counters.dropped_cell_size},
              {"full", counters.dropped_full}});
  out.metric("ivfm_updates_durable_total", "counter",
             "Robots' messages that were committed and acknowledged.",
             static_cast<double>(counters.made_durable));
}

void add_robots(MetricsText& out, const MapServer& server, TimeUs now_us) {
  const std::vector<RobotView> robots = server.robots();
  out.metric("ivfm_robots", "gauge", "Robots of the run.", static_cast<double>(robots.size()));
  out.head("ivfm_robot_silence_seconds", "gauge",
           "Since the robot was heard, on the server's clock.");
  for (const RobotView& robot : robots) {
    const std::int64_t silence_us = static_cast<std::int64_t>(now_us) - robot.last_seen_us;
    out.sample("ivfm_robot_silence_seconds{robot=\"" + std::to_string(robot.robot) + "\"}",
               std::max(0.0, static_cast<double>(silence_us) / 1e6));
  }
  out.head("ivfm_robot_apart", "gauge", "1: its place in the team's map is not known (yet).");
  for (const RobotView& robot : robots) {
    out.sample("ivfm_robot_apart{robot=\"" + std::to_string(robot.robot) + "\"}", robot.apart);
  }
}

// The metrics that every Prometheus client library gives of its process.
void add_process(MetricsText& out) {
  long pages = 0;
  std::ifstream("/proc/self/statm") >> pages >> pages;
  out.metric("process_resident_memory_bytes", "gauge", "Resident memory of the process.",
             static_cast<double>(pages) * static_cast<double>(::sysconf(_SC_PAGESIZE)));
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_usec) / 1e6;
  };
  out.metric("process_cpu_seconds_total", "counter", "User and system time of the process.",
             seconds(usage.ru_utime) + seconds(usage.ru_stime));
}

void add_histogram(MetricsText& out, const std::string& name, const std::string& help,
                   const TimeHistogram& times) {
  out.head(name, "histogram", help);
  for (std::size_t i = 0; i < TimeHistogram::kBoundsS.size(); ++i) {
    out.sample(name + "_bucket{le=\"" + text_of(TimeHistogram::kBoundsS[i]) + "\"}",
               static_cast<double>(times.at_most[i]));
  }
  out.sample(name + "_bucket{le=\"+Inf\"}", static_cast<double>(times.count));
  out.sample(name + "_sum", times.sum_s);
  out.sample(name + "_count", static_cast<double>(times.count));
}

}  // namespace

std::string prometheus_text(const MapServer& server, const TimeHistogram& commits, TimeUs now_us,
                            std::uint64_t database_bytes) {
  MetricsText out;
  out.metric("ivfm_run_seconds", "gauge", "Time of the run on the server's clock.",
             static_cast<double>(now_us) / 1e6);
  add_robots(out, server, now_us);
  add_traffic(out, server.counters());
  const MapStore& map = server.map();
  out.metric("ivfm_cells", "gauge", "Cells of the merged map.", "layer",
             {{"visits", map.explored_cells()}, {"obstacles", map.obstacle_cells()}});
  out.metric("ivfm_tiles", "gauge", "Tiles of 32 x 32 cells in memory, of all robots.",
             static_cast<double>(map.tile_count()));
  add_histogram(out, "ivfm_commit_seconds", "Real time of a transaction of the database.", commits);
  out.metric("ivfm_database_bytes", "gauge", "Size of the run database and its log.",
             static_cast<double>(database_bytes));
  add_process(out);
  return out.text();
}

}  // namespace ivfm::host

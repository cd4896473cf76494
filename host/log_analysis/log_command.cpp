#include "host/log_analysis/log_command.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "host/demo/demo_report.h"
#include "host/log_analysis/run_summary.h"

namespace ivfm::host {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostEventsInReport = 200;

std::string text_of(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string kib(std::uint64_t bytes) {
  return text_of("%.1f KiB", static_cast<double>(bytes) / 1024);
}

std::string describe(const RunSummary& run) {
  return std::to_string(run.robots.size()) + (run.robots.size() == 1 ? " robot, " : " robots, ") +
         text_of("%.0f s, ", run.time_s) + text_of("%.1f m² explored, ", run.scores.explored_m2) +
         text_of("%.1f m driven", run.driven_m);
}

cv::Mat draw_run(const fs::path& database, const RunSummary& run) {
  const LayerMap merged = load_merged_map(database);
  if (merged.bounds.empty()) {
    throw std::runtime_error("run database '" + database.string() +
                             "' holds no map: no robot has sent one");
  }
  PictureOptions picture;
  picture.title = database.filename().string();
  picture.subtitle = describe(run);
  return draw_map_picture(to_picture_layers(merged), load_trajectories(database), picture);
}

std::vector<ReportFigure> figures_of(const RunSummary& run) {
  std::uint64_t in = 0, out = 0, actions = 0;
  for (const RobotSummary& robot : run.robots) {
    in += robot.traffic.bytes_in;
    out += robot.traffic.bytes_out;
    actions += robot.actions;
  }
  return {{text_of("%.1f m²", run.scores.explored_m2), "explored",
           std::to_string(run.explored_cells) + " cells"},
          {text_of("%.0f s", run.time_s), "run time", "on the server's clock"},
          {text_of("%.1f m", run.driven_m), "driven", "all robots, by odometry"},
          {std::to_string(actions), "actions", "goals driven to"},
          {text_of("%.2f", run.scores.repeat_rate), "RER", "repeated visits a cell"},
          {text_of("%.0f", run.scores.pixels_per_metre), "PE", "pixels of 1/128 m seen a metre"},
          {text_of("%.1f %%", run.scores.overlap * 100), "overlap", "seen by two or more robots"},
          {kib(in), "from the robots", kib(out) + " to them"}};
}

// The share of what was seen in the end: a database does not know how large the world is.
std::vector<ProgressPoint> progress_of(const RunSummary& run) {
  std::vector<ProgressPoint> points;
  const double end = run.progress.empty() ? 0 : run.progress.back().explored_m2;
  const double most = std::max({end, run.scores.explored_m2, 1e-9});
  for (const ProgressRow& row : run.progress)
    points.push_back({row.time_s, row.explored_m2 / most, 0});
  return points;
}

std::vector<ReportFigure> events_of(const fs::path& database) {
  std::vector<ReportFigure> rows;
  const std::vector<TimelineEntry> entries = load_timeline(database);
  for (const TimelineEntry& entry : entries) {
    if (rows.size() == kMostEventsInReport) {
      rows.push_back(
          {"...", std::to_string(entries.size() - rows.size()) + " more: ivfm log timeline", ""});
      break;
    }
    const std::string who = entry.robot ? "robot " + std::to_string(*entry.robot) + ": " : "";
    rows.push_back({text_of("%.1f s", entry.time_s), who + entry.text, ""});
  }
  return rows;
}

DemoReport report_of(const fs::path& database, const RunSummary& run, const fs::path& picture) {
  DemoReport report;
  report.title = "Run " + database.filename().string();
  report.subtitle = describe(run) + ".";
  report.figures = figures_of(run);
  report.map_picture = picture;
  report.progress_title = "Explored over time (100 % is what was seen in the end)";
  report.progress = progress_of(run);
  report.table_head = {"robot",      "driven",   "actions",    "state at the end",
                       "from robot", "to robot", "sent again", "slowest decision"};
  for (const RobotSummary& robot : run.robots) {
    report.table.push_back(
        {robot.name, text_of("%.1f m", robot.driven_m), std::to_string(robot.actions),
         robot.last_state, kib(robot.traffic.bytes_in), kib(robot.traffic.bytes_out),
         std::to_string(robot.retransmissions), text_of("%.1f ms", robot.slowest_decision_ms)});
  }
  report.events = events_of(database);
  return report;
}

// A file that is gone at the end of its scope.
struct ScratchPicture {
  fs::path path;
  explicit ScratchPicture(const fs::path& beside)
      : path(beside.string() + "." + std::to_string(::getpid()) + ".png") {}
  ~ScratchPicture() {
    std::error_code none;
    fs::remove(path, none);
  }
};

std::string cell_text(const SqliteStatement& row, int column) {
  if (row.is_null(column)) return "";
  if (row.is_blob(column)) return "(" + std::to_string(row.blob(column).size()) + " bytes)";
  return row.text(column);
}

// Characters of a UTF-8 text.
std::size_t width_of(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xc0) != 0x80; }));
}

void print_row(const std::vector<std::string>& row, const std::vector<std::size_t>& widths,
               std::ostream& out) {
  std::string line;
  for (std::size_t i = 0; i < row.size(); ++i) {
    line += row[i];
    if (i + 1 < row.size()) line += std::string(widths[i] - width_of(row[i]) + 2, ' ');
  }
  out << line << '\n';
}

}  // namespace

void write_log_report(const fs::path& database, const fs::path& html) {
  const RunSummary run = summarize_run(database);
  const ScratchPicture picture(html);
  write_png(picture.path, draw_run(database, run));
  std::ofstream out(html);
  out << render_report(report_of(database, run, picture.path));
  out.close();
  if (!out) throw std::runtime_error("report '" + html.string() + "' cannot be written");
}

void write_log_map(const fs::path& database, const fs::path& png) {
  write_png(png, draw_run(database, summarize_run(database)));
}

std::string log_metrics(const fs::path& database) {
  const RunSummary run = summarize_run(database);
  nlohmann::ordered_json json{{"time_s", run.time_s},
                              {"cell_m", run.cell_m},
                              {"explored_cells", run.explored_cells},
                              {"obstacle_cells", run.obstacle_cells},
                              {"explored_m2", run.scores.explored_m2},
                              {"driven_m", run.driven_m},
                              {"rer", run.scores.repeat_rate},
                              {"pe", run.scores.pixels_per_metre},
                              {"overlap", run.scores.overlap},
                              {"robots", nlohmann::ordered_json::array()}};
  for (const RobotSummary& robot : run.robots) {
    json["robots"].push_back({{"robot", robot.robot},
                              {"name", robot.name},
                              {"state", robot.last_state},
                              {"driven_m", robot.driven_m},
                              {"actions", robot.actions},
                              {"slowest_decision_ms", robot.slowest_decision_ms},
                              {"retransmissions", robot.retransmissions},
                              {"bytes_in", robot.traffic.bytes_in},
                              {"bytes_out", robot.traffic.bytes_out}});
  }
  return json.dump(2);
}

void print_query(const fs::path& database, const std::string& sql, std::ostream& out) {
  SqliteConnection connection = open_run_database(database);
  SqliteStatement query(connection, sql.c_str());
  std::vector<std::vector<std::string>> table(1);
  for (int i = 0; i < query.column_count(); ++i) table[0].push_back(query.column_name(i));
  if (table[0].empty()) throw std::runtime_error("the query yields no columns: begin with SELECT");
  while (query.row()) {
    std::vector<std::string> row;
    for (int i = 0; i < query.column_count(); ++i) row.push_back(cell_text(query, i));
    table.push_back(std::move(row));
  }
  std::vector<std::size_t> widths(table[0].size());
  for (const auto& row : table) {
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], width_of(row[i]));
  }
  for (const auto& row : table) print_row(row, widths, out);
}

void print_timeline(const fs::path& database, std::ostream& out) {
  for (const TimelineEntry& entry : load_timeline(database)) {
    out << text_of("%10.1f s  ", entry.time_s)
        << (entry.robot ? "robot " + std::to_string(*entry.robot) + "  " : "") << entry.text
        << '\n';
  }
}

void add_log_command(CLI::App& app, CommandAction& action) {
  CLI::App* log = app.add_subcommand("log", "What happened in a run: report, map, figures, tables");
  log->require_subcommand(1);
  log->footer("Example: ivfm log report run.db -o report.html");
  struct Options {
    fs::path database, output;
    std::string sql;
  };
  auto options = std::make_shared<Options>();
  const auto add = [&](const char* name, const char* text, const char* example, auto work) {
    CLI::App* command = log->add_subcommand(name, text);
    command->add_option("database", options->database, "run database of 'ivfm serve'")->required();
    command->footer(std::string("Example: ") + example);
    command->callback([options, &action, work] {
      action = [options, work] {
        work(*options);
        return 0;
      };
    });
    return command;
  };
  const auto or_default = [](const fs::path& given, const char* name) {
    return given.empty() ? fs::path(name) : given;
  };
  add("report", "One self-contained HTML page", "ivfm log report run.db -o report.html",
      [or_default](const Options& o) {
        write_log_report(o.database, or_default(o.output, "report.html"));
      })
      ->add_option("-o,--output", options->output, "file to write [report.html]");
  add("map", "The merged map as a PNG picture", "ivfm log map run.db -o map.png",
      [or_default](const Options& o) {
        write_log_map(o.database, or_default(o.output, "map.png"));
      })
      ->add_option("-o,--output", options->output, "file to write [map.png]");
  add("metrics", "The run's figures as JSON", "ivfm log metrics run.db",
      [](const Options& o) { std::cout << log_metrics(o.database) << std::endl; });
  add("query", "Ask the database in SQL", "ivfm log query run.db \"SELECT * FROM events\"",
      [](const Options& o) { print_query(o.database, o.sql, std::cout); })
      ->add_option("sql", options->sql, "a SELECT; docs/run_database.md names the tables")
      ->required();
  add("timeline", "Starts, states and faults in the order of time", "ivfm log timeline run.db",
      [](const Options& o) { print_timeline(o.database, std::cout); });
}

}  // namespace ivfm::host

#include "host/log_analysis/log_command.h"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <memory>
#include <stdexcept>

#include "host/can_analysis/can_command.h"
#include "host/can_analysis/can_log.h"
#include "host/cli/progress_line.h"
#include "host/log_analysis/drive_data.h"
#include "host/log_analysis/export_command.h"
#include "host/log_analysis/run_compare.h"
#include "host/log_analysis/run_report.h"
#include "host/log_analysis/run_video.h"

namespace ivfm::host {
namespace {

namespace fs = std::filesystem;

std::string text_of(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

// How far the reading of a database is.
class ReadingLine {
 public:
  explicit ReadingLine(const fs::path& database)
      : line_(100, "% of " + database.filename().string()) {}
  LoadProgress progress() {
    return [this](std::uint64_t percent) { line_(percent); };
  }
  void begin_step(const std::string& what) { line_.begin_step(what); }

 private:
  ProgressLine line_;
};

RunData load_any(const fs::path& file, const LoadProgress& progress) {
  return is_recorded_drive(file) ? load_drive(file, progress) : load_run(file, progress);
}

RunData load_with_progress(const fs::path& database) {
  RunData run;
  {
    ReadingLine line(database);
    run = load_any(database, line.progress());
  }
  tell(database, run.warnings);
  return run;
}

void write_text(const fs::path& path, const std::string& text) {
  std::ofstream out(path, std::ios::binary);
  out << text;
  out.close();
  if (!out) throw std::runtime_error("'" + path.string() + "' cannot be written");
}

void write_video(const fs::path& database, const fs::path& mp4, const VideoOptions& options) {
  Warnings warnings;
  {
    ProgressLine line(static_cast<std::uint64_t>(options.length_s * options.frames_per_s),
                      "frames");
    line.begin_step("Reading " + database.string());
    warnings = write_run_video(database, mp4, options, [&line](std::uint64_t done) { line(done); });
  }
  tell(database, warnings);
}

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

void tell(const fs::path& database, const Warnings& warnings) {
  for (const std::string& warning : warnings) {
    std::cerr << "ivfm log: " << database.string() << ": " << warning << '\n';
  }
}

void write_log_report(const fs::path& database, const fs::path& html) {
  RunData run;
  {
    ReadingLine line(database);
    run = load_any(database, line.progress());
    const std::vector<TimelineEntry> timeline =
        run.recorded ? drive_timeline(run) : load_timeline(database, run.warnings, line.progress());
    line.begin_step("Drawing the map");
    const cv::Mat map = run.explored_cells + run.obstacle_cells > 0 ? draw_run(run) : cv::Mat();
    line.begin_step("Writing " + html.string());
    write_text(html, render_run_report(run, timeline, map));
  }
  tell(database, run.warnings);
}

void write_log_map(const fs::path& database, const fs::path& png) {
  RunData run;
  {
    ReadingLine line(database);
    run = load_any(database, line.progress());
    line.begin_step("Drawing the map");
    write_png(png, draw_run(run));
  }
  tell(database, run.warnings);
}

void print_query(const fs::path& database, const std::string& sql, std::ostream& out) {
  SqliteConnection connection = open_run_database(database);
  SqliteStatement query(connection, sql.c_str());
  std::vector<std::vector<std::string>> table(1);
  for (int i = 0; i < query.column_count(); ++i) table[0].push_back(query.column_name(i));
  if (table[0].empty()) throw std::runtime_error("the query yields no columns: begin with SELECT");
  Warnings warnings;
  salvage(warnings, "a part of the answer", [&] {
    ProgressLine line;
    while (query.row()) {
      std::vector<std::string> row;
      for (int i = 0; i < query.column_count(); ++i) row.push_back(cell_text(query, i));
      table.push_back(std::move(row));
      line.say(std::to_string(table.size() - 1) + " rows");
    }
  });
  std::vector<std::size_t> widths(table[0].size());
  for (const auto& row : table) {
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], width_of(row[i]));
  }
  for (const auto& row : table) print_row(row, widths, out);
  tell(database, warnings);
}

void print_timeline(const fs::path& database, std::ostream& out) {
  Warnings warnings;
  std::vector<TimelineEntry> entries;
  {
    ReadingLine line(database);
    if (is_recorded_drive(database)) {
      const RunData run = load_drive(database, line.progress());
      entries = drive_timeline(run);
      warnings = run.warnings;
    } else {
      entries = load_timeline(database, warnings, line.progress());
    }
  }
  for (const TimelineEntry& entry : entries) {
    out << text_of("%10.1f s  ", entry.time_s)
        << (entry.robot ? "robot " + std::to_string(*entry.robot) + "  " : "") << entry.text
        << '\n';
  }
  tell(database, warnings);
}

namespace {

struct LogOptions {
  fs::path database, second, output;
  std::string sql;
  VideoOptions video;
  bool json = false;
};

void compare(const LogOptions& options) {
  const RunData a = load_with_progress(options.database), b = load_with_progress(options.second);
  if (!options.output.empty()) write_text(options.output, compare_as_html(a, b));
  std::cout << (options.json ? compare_as_json(a, b) + "\n" : compare_as_text(a, b));
}

void print_metrics(const LogOptions& options) {
  const RunData run = load_with_progress(options.database);
  std::cout << (options.json ? metrics_json(run) + "\n" : metrics_text(run));
}

// Files of which another command makes something.
void refuse_other_kinds(const fs::path& file, bool takes_drives) {
  std::ifstream in(file, std::ios::binary);
  std::string line(200, '\0');
  in.read(line.data(), static_cast<std::streamsize>(line.size()));
  line.resize(static_cast<std::size_t>(std::max<std::streamsize>(0, in.gcount())));
  if (parse_candump(line.substr(0, line.find('\n')))) {
    throw std::runtime_error("'" + file.string() + "' is a CAN log, which 'ivfm log can' reads");
  }
  if (!takes_drives && fs::exists(file) && is_recorded_drive(file)) {
    throw std::runtime_error(
        "'" + file.string() +
        "' is a recorded drive; 'ivfm log' makes report, map, metrics, compare "
        "and timeline of it, and 'ivfm replay' plays it");
  }
}

using LogWork = void (*)(const LogOptions&);

// Adds the subcommands that read a run database.
class LogCommands {
 public:
  LogCommands(CLI::App& log, CommandAction& action) : log_(log), action_(action) {}

  CLI::App* add(const char* name, const char* text, const char* example, LogWork work,
                bool takes_drives = true) {
    CLI::App* command = log_.add_subcommand(name, text);
    command
        ->add_option("database", options_->database,
                     takes_drives ? "run database of 'ivfm serve', or a drive: rawlog, recording"
                                  : "run database of 'ivfm serve'")
        ->required();
    command->footer(std::string("Example: ") + example);
    command->callback([options = options_, &action = action_, work, takes_drives] {
      action = [options, work, takes_drives] {
        refuse_other_kinds(options->database, takes_drives);
        work(*options);
        return 0;
      };
    });
    return command;
  }
  void output(CLI::App* command, const char* name) {
    std::string text = "file to write";
    if (*name != '\0') text += std::string(" [") + name + "]";
    command->add_option("-o,--output", options_->output, text);
  }
  void json(CLI::App* command) { command->add_flag("--json", options_->json, "one JSON object"); }
  LogOptions& options() { return *options_; }

 private:
  CLI::App& log_;
  CommandAction& action_;
  std::shared_ptr<LogOptions> options_ = std::make_shared<LogOptions>();
};

fs::path output_or(const LogOptions& options, const char* name) {
  return options.output.empty() ? fs::path(name) : options.output;
}

void add_pictures(LogCommands& commands) {
  commands.output(
      commands.add(
          "report", "One self-contained HTML page", "ivfm log report run.db -o report.html",
          [](const LogOptions& o) { write_log_report(o.database, output_or(o, "report.html")); }),
      "report.html");
  commands.output(
      commands.add("map", "The merged map as a PNG picture", "ivfm log map run.db -o map.png",
                   [](const LogOptions& o) { write_log_map(o.database, output_or(o, "map.png")); }),
      "map.png");
  CLI::App* video = commands.add(
      "video", "A film: the map grows, the robots drive",
      "ivfm log video run.db -o run.mp4 --length 30",
      [](const LogOptions& o) { write_video(o.database, output_or(o, "run.mp4"), o.video); },
      false);
  commands.output(video, "run.mp4");
  VideoOptions& film = commands.options().video;
  video->add_option("--length", film.length_s, "seconds of the film, whatever the run's")
      ->check(CLI::Range(1.0, 3600.0))
      ->capture_default_str();
  video->add_option("--width", film.width_px, "pixels at most")
      ->check(CLI::Range(320, 3840))
      ->capture_default_str();
}

void add_tables(LogCommands& commands) {
  commands.json(commands.add("metrics", "The run's figures", "ivfm log metrics run.db --json",
                             print_metrics));
  CLI::App* two = commands.add("compare", "Two runs side by side",
                               "ivfm log compare a.db b.db -o compare.html", compare);
  two->add_option("second", commands.options().second, "the other run's database")->required();
  commands.output(two, "");
  commands.json(two);
  commands
      .add(
          "query", "Ask the database in SQL", "ivfm log query run.db \"SELECT * FROM events\"",
          [](const LogOptions& o) { print_query(o.database, o.sql, std::cout); }, false)
      ->add_option("sql", commands.options().sql, "a SELECT; docs/run_database.md names the tables")
      ->required();
  commands.add("timeline", "Starts, states and faults in the order of time",
               "ivfm log timeline run.db",
               [](const LogOptions& o) { print_timeline(o.database, std::cout); });
}

}  // namespace

void add_log_command(CLI::App& app, CommandAction& action) {
  CLI::App* log =
      app.add_subcommand("log", "What happened in a run: report, map, film, figures, CAN, exports");
  log->require_subcommand(1);
  log->footer("Example: ivfm log report run.db -o report.html");
  LogCommands commands(*log, action);
  add_pictures(commands);
  add_tables(commands);
  add_can_log_command(*log, action);
  add_export_log_command(*log, action);
}

}  // namespace ivfm::host

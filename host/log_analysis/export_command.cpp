#include "host/log_analysis/export_command.h"

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>

#include "host/can_analysis/can_export.h"
#include "host/cli/progress_line.h"
#include "host/log_analysis/log_command.h"
#include "host/log_analysis/run_export.h"
#include "host/simulator/rawlog_export.h"

namespace ivfm::host {
namespace {

namespace fs = std::filesystem;

struct Options {
  fs::path input, output;
  std::string format;
  CanSelection can;
};

// The poses of a run, on the wall clock of its first session.
std::vector<TimedPose> load_poses(const fs::path& database, const LoadProgress& progress,
                                  Warnings& warnings) {
  SqliteConnection connection = open_run_database(database);
  const auto whole = [&](const char* sql) {
    std::int64_t value = 0;
    salvage(warnings, "a part of it", [&] { value = connection.integer(sql).value_or(0); });
    return value;
  };
  const double start_s =
      static_cast<double>(whole("SELECT min(started_unix_us) FROM sessions")) / 1e6;
  const auto total = std::max<std::int64_t>(1, whole("SELECT max(rowid) FROM poses"));
  std::vector<TimedPose> poses;
  salvage(warnings, "a part of its poses", [&] {
    SqliteStatement rows(connection, "SELECT time_us, robot, x_um, y_um, heading FROM poses");
    while (rows.row()) {
      poses.push_back({start_s + static_cast<double>(rows.integer(0)) / 1e6,
                       "robot " + std::to_string(rows.integer(1)),
                       {{static_cast<std::int32_t>(rows.integer(2)),
                         static_cast<std::int32_t>(rows.integer(3))},
                        BinaryAngle(static_cast<std::uint16_t>(rows.integer(4)))}});
      // Reading is the smaller part.
      if (poses.size() % 4096 == 0) progress(poses.size() * 20 / static_cast<std::uint64_t>(total));
    }
  });
  if (poses.empty()) {
    throw std::runtime_error("run database '" + database.string() +
                             (warnings.empty() ? "' holds no pose" : "': " + warnings.back()));
  }
  return poses;
}

Warnings export_rawlog(const Options& options, const LoadProgress& progress) {
  Warnings warnings;
  if (is_recording(options.input)) {
    const Recording recording = read_recording(options.input);
    if (!recording.warning.empty()) std::cerr << "ivfm log: " << recording.warning << '\n';
    write_scan_rawlog(options.output, recording, 0);
  } else {
    const auto poses = load_poses(options.input, progress, warnings);
    write_pose_rawlog(options.output, poses,
                      [&](std::size_t done) { progress(20 + 80 * done / poses.size()); });
  }
  return warnings;
}

Warnings export_file(const Options& options, const LoadProgress& progress) {
  if (options.format == "rawlog") return export_rawlog(options, progress);
  if (options.format == "ros-map") return export_ros_map(options.input, options.output, progress);
  if (options.format == "csv") return export_csv(options.input, options.output, progress);
  if (options.format == "svg") return export_svg(options.input, options.output, progress);
  if (options.format == "candump") {
    export_candump(options.input, options.can, options.output, progress);
  } else {
    export_signals_csv(options.input, options.can, options.output, progress);
  }
  return {};
}

int run_export(const Options& options) {
  Warnings warnings;
  {
    ProgressLine line(100, "% of " + options.input.filename().string());
    warnings = export_file(options, [&line](std::uint64_t percent) { line(percent); });
  }
  tell(options.input, warnings);
  return 0;
}

}  // namespace

void add_export_log_command(CLI::App& log, CommandAction& action) {
  auto options = std::make_shared<Options>();
  CLI::App* command = log.add_subcommand(
      "export", "Files for other tools: MRPT, ROS, can-utils, spreadsheets, drawings");
  command->add_option("file", options->input, "run database, CAN log or recording")->required();
  command
      ->add_option("--to", options->format,
                   "of a run database: rawlog (MRPT: the poses), ros-map (YAML and PGM), csv (a "
                   "folder, a file a table), svg (map and paths); of a CAN log: candump (a part of "
                   "it), can-csv (its signals); of a recording: rawlog (scans and odometry)")
      ->required()
      ->check(CLI::IsMember({"rawlog", "ros-map", "csv", "svg", "candump", "can-csv"}));
  command->add_option("-o,--output", options->output, "file or folder to write")->required();
  command->add_option("--bus", options->can.bus, "this bus of a CAN log only");
  command->add_option("--from", options->can.from_s, "seconds after a CAN log's first frame");
  command->add_option("--until", options->can.to_s, "seconds after a CAN log's first frame");
  command->footer("Example: ivfm log export run.db --to ros-map -o map.yaml");
  command->callback([options, &action] { action = [options] { return run_export(*options); }; });
}

}  // namespace ivfm::host

#include "host/can_analysis/can_command.h"

#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <memory>
#include <stdexcept>
#include <string>

#include "host/can_analysis/can_analysis.h"
#include "host/cli/progress_line.h"

namespace ivfm::host {
namespace {

namespace fs = std::filesystem;

struct Options {
  fs::path log, output, dbc, eds;
  WheelScale scale;
  bool json = false;
};

std::string text_of_file(const fs::path& path, std::string_view shipped) {
  if (path.empty()) return std::string(shipped);
  std::ifstream in(path, std::ios::binary);
  if (!in) throw std::runtime_error("'" + path.string() + "' cannot be read");
  return {std::istreambuf_iterator<char>(in), {}};
}

int analyze(const Options& options) {
  CanAnalyzer analyzer(text_of_file(options.dbc, shipped_dbc()),
                       text_of_file(options.eds, shipped_eds()));
  CanReport report;
  {
    std::error_code none;
    const auto size = fs::file_size(options.log, none);
    ProgressLine line(none ? 1 : size >> 20, "MiB");
    report = analyzer.finish(read_can_log(
        options.log, [&](const CanLogFrame& frame) { analyzer.take(frame); },
        [&](std::uint64_t bytes) { line(bytes >> 20); }));
  }
  if (!options.output.empty()) {
    std::ofstream out(options.output);
    out << can_report_html(options.log.filename().string(), report, options.scale);
    out.close();
    if (!out) throw std::runtime_error("'" + options.output.string() + "' cannot be written");
  }
  std::cout << (options.json ? can_report_json(report, options.scale)
                             : can_report_text(report, options.scale));
  return 0;
}

}  // namespace

void add_can_log_command(CLI::App& log, CommandAction& action) {
  auto options = std::make_shared<Options>();
  CLI::App* command = log.add_subcommand(
      "can", "A candump log: wheel speeds, states, faults, violations of the protocol");
  command->add_option("file", options->log, "log of 'ivfm canbus --log' or 'candump -l'")
      ->required();
  command->add_option("-o,--output", options->output, "HTML page with plots to write");
  command->add_option("--dbc", options->dbc, "frames of the bus [the shipped ivfm_bus.dbc]");
  command->add_option("--eds", options->eds, "objects of the drives [the shipped ivfm_drive.eds]");
  command->add_option("--wheel-radius", options->scale.radius_m, "metres")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--counts-per-rev", options->scale.counts_per_turn, "encoder counts a turn")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_flag("--json", options->json, "one JSON object");
  command->footer("Example: ivfm log can out/demo/can.log -o can.html");
  command->callback([options, &action] { action = [options] { return analyze(*options); }; });
}

}  // namespace ivfm::host

// `ivfm-train`: trains a policy, writes its curves, its float network and its int8 model file.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <csignal>
#include <cstring>
#include <exception>
#include <iostream>
#include <string>

#include "host/cli/manual.h"
#include "host/quantizer/network_commands.h"
#include "host/trainer/trainer.h"

namespace {

using ivfm::host::TrainerConfig;

std::atomic<bool> stop_requested{false};

void request_stop(int) { stop_requested = true; }

// The value of --config, so that the file is read before the flags that override it.
std::string config_argument(int argc, char** argv) {
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--config") == 0 && i + 1 < argc) return argv[i + 1];
    if (std::strncmp(argv[i], "--config=", 9) == 0) return argv[i] + 9;
  }
  return "";
}

void add_options(CLI::App& app, TrainerConfig& config, std::string& config_path, bool& dry_run) {
  app.add_option("--config", config_path, "TOML file of options; flags override it");
  app.add_flag("--dry-run", dry_run, "print the options as a TOML file and stop");
  app.add_option("--out", config.out, "same as --run.out");
  app.add_option("--seed", config.seed, "same as --run.seed");
  app.add_flag("--fresh", config.fresh, "same as --run.fresh=true");
  ivfm::host::visit_options(config, [&app](const std::string& name, auto& value, const char* help) {
    app.add_option("--" + name, value, help)
        ->capture_default_str()
        ->group("[" + name.substr(0, name.find('.')) + "]");
  });
  app.footer(
      "Example: ivfm-train --config host/trainer/recipes/default.toml --out out/train\n"
      "Ctrl-C saves a checkpoint; the same command goes on from it.");
}

// On a terminal one line that is written over, elsewhere one line a report.
void print_progress(const std::string& line) {
  static const bool is_terminal = isatty(STDERR_FILENO) != 0;
  const bool lasting = line.rfind("step", 0) != 0;
  if (is_terminal) std::cerr << "\r\033[K";
  std::cerr << line << (is_terminal && !lasting ? "" : "\n") << std::flush;
}

int train(const TrainerConfig& config) {
  ivfm::host::Trainer trainer(config, print_progress);
  std::signal(SIGINT, request_stop);
  std::signal(SIGTERM, request_stop);
  if (!trainer.run(stop_requested)) {
    std::cerr << "ivfm-train: stopped at step " << trainer.step()
              << "; the same command goes on from there\n";
    return 1;
  }
  trainer.export_model();
  std::cout << config.out << "/model.ivfm\n";
  return 0;
}

int run(int argc, char** argv) {
  TrainerConfig config;
  std::string config_path = config_argument(argc, argv);
  if (!config_path.empty()) ivfm::host::load_config(config_path, config);
  CLI::App app{"ivfm-train: train a Q-network that explores, and quantize it for the robot",
               "ivfm-train"};
  bool dry_run = false;
  add_options(app, config, config_path, dry_run);
  ivfm::host::CommandAction action;  // of a subcommand; without one it trains
  ivfm::host::add_network_commands(app, action);
  ivfm::host::add_manual_command(app, action);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  if (action) return action();
  ivfm::host::check(config);
  if (dry_run) {
    std::cout << ivfm::host::to_toml(config);
    return 0;
  }
  return train(config);
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "ivfm-train: " << error.what() << '\n';
    return 1;
  }
}

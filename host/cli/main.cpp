// `ivfm`: the host tool. Parses the command line and runs one subcommand.
#include <CLI/CLI.hpp>
#include <exception>
#include <iostream>

#include "firmware/agent/linux/agent_options.h"
#include "host/canbus/canbus_command.h"
#include "host/cli/commands.h"
#include "host/cli/manual.h"
#include "host/demo/demo_command.h"
#include "host/demo/rehearse_command.h"
#include "host/evaluation/eval_command.h"
#include "host/localization/localize_command.h"
#include "host/log_analysis/log_command.h"
#include "host/map_server/keygen_command.h"
#include "host/map_server/serve_command.h"
#include "host/radio/radio_command.h"
#include "host/simulator/replay_command.h"
#include "host/simulator/sim_command.h"

namespace {

int run(int argc, char** argv) {
  CLI::App app{"ivfm: explore unknown places with several cheap robots", "ivfm"};
  app.require_subcommand(1);
  app.set_version_flag("--version", "ivfm 0.1.0");
  ivfm::host::CommandAction action;
  // One line a subcommand, in the order of `ivfm --help`.
  ivfm::host::add_demo_command(app, action);
  ivfm::host::add_rehearse_command(app, action);
  ivfm::host::add_sim_command(app, action);
  ivfm::host::add_eval_command(app, action);
  ivfm::host::add_localize_command(app, action);
  ivfm::host::add_canbus_command(app, action);
  ivfm::host::add_replay_command(app, action);
  ivfm::host::add_serve_command(app, action);
  ivfm::host::add_keygen_command(app, action);
  ivfm::host::add_radio_command(app, action);
  ivfm::host::add_log_command(app, action);
  ivfm::host::add_manual_command(app, action, ivfm::show_agent_command_line);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  return action ? action() : 2;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "ivfm: " << error.what() << '\n';
    return 1;
  }
}

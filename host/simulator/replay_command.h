// `ivfm replay`: a recorded drive as RPLIDAR bytes, on a pseudo-terminal or through the explorer.
#pragma once

#include "host/cli/commands.h"

namespace ivfm::host {

// Adds the subcommand.
void add_replay_command(CLI::App& app, CommandAction& action);

}  // namespace ivfm::host

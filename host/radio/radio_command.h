// `ivfm radio`: a bad radio between the robots and the map server.
#pragma once

#include "host/cli/commands.h"

namespace ivfm::host {

// Adds the subcommand.
void add_radio_command(CLI::App& app, CommandAction& action);

}  // namespace ivfm::host

// `ivfm rehearse`: many runs of whole agents in simulated time, and what they come to in the mean.
#pragma once

#include "host/cli/commands.h"

namespace ivfm::host {

// Adds the subcommand.
void add_rehearse_command(CLI::App& app, CommandAction& action);

}  // namespace ivfm::host

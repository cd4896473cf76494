// Subcommands of `ivfm-train` for a finished network: export, quantize, compare.
#pragma once

#include "host/cli/commands.h"

namespace ivfm::host {

// Adds the subcommands.
void add_network_commands(CLI::App& app, CommandAction& action);

}  // namespace ivfm::host

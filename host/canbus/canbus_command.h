// `ivfm canbus`: a CAN bus in user space for machines whose kernel has none.
#pragma once

#include "host/cli/commands.h"

namespace ivfm::host {

// Adds the subcommand.
void add_canbus_command(CLI::App& app, CommandAction& action);

}  // namespace ivfm::host

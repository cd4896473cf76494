// `ivfm demo`: a whole exploration run in software in the loop, with its report.
#pragma once

#include "host/cli/commands.h"

namespace ivfm::host {

// Adds the subcommand.
void add_demo_command(CLI::App& app, CommandAction& action);

}  // namespace ivfm::host

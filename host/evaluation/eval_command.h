// `ivfm eval`: judges a policy in a world, in process, on the firmware's own code.
#pragma once

#include "host/cli/commands.h"

namespace ivfm::host {

// Adds the subcommand.
void add_eval_command(CLI::App& app, CommandAction& action);

}  // namespace ivfm::host

// `ivfm log can`: what a candump log tells of the wheel drives.
#pragma once

#include "host/cli/commands.h"

namespace ivfm::host {

void add_can_log_command(CLI::App& log, CommandAction& action);

}  // namespace ivfm::host

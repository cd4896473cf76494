// `ivfm log export`: runs, CAN logs and recordings in the formats of other tools.
#pragma once

#include "host/cli/commands.h"

namespace ivfm::host {

void add_export_log_command(CLI::App& log, CommandAction& action);

}  // namespace ivfm::host

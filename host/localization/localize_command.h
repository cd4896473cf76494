// `ivfm localize`: how far robots are from where they believe to be.
#pragma once

#include "host/cli/commands.h"

namespace ivfm::host {

void add_localize_command(CLI::App& app, CommandAction& action);

}  // namespace ivfm::host

// `ivfm sim`: simulated robots for agents to connect to: lidars on serial lines, drives on CAN.
#pragma once

#include "host/cli/commands.h"

namespace ivfm::host {

// Adds the subcommand.
void add_sim_command(CLI::App& app, CommandAction& action);

}  // namespace ivfm::host

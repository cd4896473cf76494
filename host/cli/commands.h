// The subcommands of `ivfm`: each adds itself to the command line and stores what to run.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace ivfm::host {

// Set by the subcommand that the user chose; its value is the exit code (0 done, 1 failed).
using CommandAction = std::function<int()>;

}  // namespace ivfm::host

// Man pages and shell completions out of the same tree of commands that --help prints.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <functional>
#include <string>

#include "host/cli/commands.h"

namespace ivfm::host {

// The page of `command` in roff; `words`: as it is typed, such as "ivfm log report".
std::string man_page(const CLI::App& command, const std::string& words);
// Completion scripts of the whole tree.
std::string bash_completion(const CLI::App& root);
std::string zsh_completion(const CLI::App& root);

// Writes share/man/man1/*.1, share/bash-completion/completions/NAME and
// share/zsh/site-functions/_NAME below `folder`. Throws std::runtime_error when it cannot.
void write_manual(const CLI::App& root, const std::filesystem::path& folder);

using ShowCommandLine = std::function<void(const CLI::App&)>;
// Adds the hidden subcommand `manual FOLDER` that does so, also for a program without subcommands
// of its own, if `show_other` shows its command line.
void add_manual_command(CLI::App& app, CommandAction& action,
                        std::function<void(const ShowCommandLine&)> show_other = {});

}  // namespace ivfm::host

// `ivfm keygen`: the radio keys of a team.
#pragma once

#include <filesystem>
#include <iosfwd>

#include "host/cli/commands.h"

namespace ivfm::host {

// Writes FOLDER/server.keys with the keys of robots 1 .. `robots`, and FOLDER/robotN.key for each,
// all of mode 600. Keys that server.keys holds already stay as they are. Says on `out` what it
// wrote. Throws std::runtime_error with one sentence.
void write_team_keys(int robots, const std::filesystem::path& folder, std::ostream& out);

void add_keygen_command(CLI::App& app, CommandAction& action);

}  // namespace ivfm::host

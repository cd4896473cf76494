// Files that are either the old or the new content, whenever the program is killed.
#pragma once

#include <functional>
#include <string>

namespace ivfm::host {

// Calls `write` with the name of a temporary file beside `path`, then renames it to `path`.
// Throws std::runtime_error naming `path` when `write` throws or the file cannot be renamed.
void write_atomically(const std::string& path,
                      const std::function<void(const std::string&)>& write);

}  // namespace ivfm::host

// Where things lie: this program, and the policy that ships with the source tree.
#pragma once

#include <filesystem>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

namespace ivfm::host {

// This program.
inline std::filesystem::path own_path() {
  std::error_code none;
  return std::filesystem::read_symlink("/proc/self/exe", none);
}

// `path` itself, then the folder it is in, and so on to the root.
inline std::vector<std::filesystem::path> folders_above(std::filesystem::path path) {
  std::vector<std::filesystem::path> folders;
  for (; !path.empty(); path = path.parent_path()) {
    folders.push_back(path);
    if (path == path.root_path()) break;
  }
  return folders;
}

// The first models/*`extension` by name (".ivfm": int8, ".fnet": float) in a folder above this
// program or the working folder. Throws std::runtime_error with one sentence when there is none.
inline std::filesystem::path shipped_model(const std::string& extension) {
  namespace fs = std::filesystem;
  std::error_code none;
  for (const fs::path& place : {own_path(), fs::current_path(none)}) {
    for (const fs::path& folder : folders_above(place)) {
      std::set<fs::path> models;
      for (const auto& entry : fs::directory_iterator(folder / "models", none)) {
        if (entry.path().extension() == extension) models.insert(entry.path());
      }
      if (!models.empty()) return *models.begin();
    }
  }
  throw std::runtime_error("no folder above the program or the working folder has models/*" +
                           extension + ": give --model FILE, or --policy frontier-nearest");
}

}  // namespace ivfm::host

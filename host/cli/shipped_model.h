// Where the policy that ships with the source tree lies.
#pragma once

#include <filesystem>
#include <set>
#include <stdexcept>
#include <string>

namespace ivfm::host {

// The first models/*`extension` by name (".ivfm": int8, ".fnet": float) in a folder above this
// program or the working folder. Throws std::runtime_error with one sentence when there is none.
inline std::filesystem::path shipped_model(const std::string& extension) {
  namespace fs = std::filesystem;
  std::error_code none;
  for (fs::path folder : {fs::read_symlink("/proc/self/exe", none), fs::current_path(none)}) {
    for (; !folder.empty(); folder = folder.parent_path()) {
      std::set<fs::path> models;
      for (const auto& entry : fs::directory_iterator(folder / "models", none)) {
        if (entry.path().extension() == extension) models.insert(entry.path());
      }
      if (!models.empty()) return *models.begin();
      if (folder == folder.root_path()) break;
    }
  }
  throw std::runtime_error("no folder above the program or the working folder has models/*" +
                           extension + ": give --model FILE, or --policy frontier-nearest");
}

}  // namespace ivfm::host

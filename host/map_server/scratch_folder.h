// A folder for one test's files, removed when the test ends.
#pragma once

#include <stdlib.h>

#include <filesystem>
#include <stdexcept>
#include <string>

namespace ivfm::host {

// In memory (/dev/shm) where there is one: SQLite's fsync then costs nothing.
class ScratchFolder {
 public:
  ScratchFolder() {
    std::error_code ignored;
    const bool shm = std::filesystem::is_directory("/dev/shm", ignored);
    std::string name = std::string(shm ? "/dev/shm" : "/tmp") + "/ivfm-test-XXXXXX";
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("no scratch folder");
    path_ = name;
  }
  ~ScratchFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace ivfm::host

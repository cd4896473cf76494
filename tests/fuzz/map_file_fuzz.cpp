// A map's YAML and image, separated by the first zero byte.
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

#include "host/simulator/map_file.h"
#include "tests/fuzz/fuzz_input.h"

namespace {

namespace fs = std::filesystem;

struct Folder {
  Folder() : path(fs::temp_directory_path() / ("map_file_fuzz." + std::to_string(::getpid()))) {
    fs::create_directories(path);
  }
  ~Folder() { fs::remove_all(path); }
  fs::path path;
};

void write(const fs::path& path, std::span<const std::uint8_t> bytes) {
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
}

void load(const fs::path& path, std::optional<double> resolution_m) {
  try {
    const auto world = ivfm::host::load_map_file(path, resolution_m);
    ivfm::fuzz::require(
        world.occupied.size() == static_cast<std::size_t>(world.width) * world.height &&
            static_cast<std::int64_t>(world.occupied.size()) <= ivfm::host::kMaxMapCells,
        "a world has its cells");
  } catch (const std::runtime_error&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const Folder folder;
  const std::span bytes(data, size);
  const auto middle = static_cast<std::size_t>(std::ranges::find(bytes, 0) - bytes.begin());
  write(folder.path / "map.yaml", bytes.first(middle));
  write(folder.path / "map.pgm", bytes.subspan(std::min(middle + 1, size)));
  load(folder.path / "map.yaml", std::nullopt);
  load(folder.path / "map.pgm", 0.05);
  return 0;
}

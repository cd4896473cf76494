#include "firmware/agent/linux/agent_files.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>
#include <stdexcept>

#include "shared/wire/map_dump.h"

namespace ivfm {

namespace {

struct FileCloser {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using File = std::unique_ptr<std::FILE, FileCloser>;

File open_file(const std::string& path, const char* mode, const char* purpose) {
  File file(std::fopen(path.c_str(), mode));
  if (file) return file;
  throw std::runtime_error(std::string("cannot ") + purpose + " " + path + ": " +
                           std::strerror(errno));
}

class FileSink final : public ByteSink {
 public:
  explicit FileSink(std::FILE* file) : file_(file) {}
  Status write(std::span<const std::uint8_t> bytes) override {
    const std::size_t done = std::fwrite(bytes.data(), 1, bytes.size(), file_);
    return done == bytes.size() ? Status::kOk : Status::kIoError;
  }

 private:
  std::FILE* file_;
};

class OwnRows final : public MapRowSource {
 public:
  explicit OwnRows(const ExplorationMap& map) : map_(map) {}
  Status read_row(Layer layer, std::int32_t y, std::span<std::uint8_t> out) const override {
    const CellRect& window = map_.frame().window();
    return map_.read_own(layer, {window.x, y, window.width, 1}, out);
  }

 private:
  const ExplorationMap& map_;
};

}  // namespace

std::vector<std::uint8_t> read_model_file(const std::string& path) {
  const File file = open_file(path, "rb", "read the model");
  std::vector<std::uint8_t> bytes(kMaxModelBytes + 1);
  bytes.resize(std::fread(bytes.data(), 1, bytes.size(), file.get()));
  if (std::ferror(file.get())) throw std::runtime_error("cannot read the model " + path);
  if (bytes.size() > kMaxModelBytes) {
    throw std::runtime_error(path + " is no model: it is larger than a model can be");
  }
  return bytes;
}

void write_map_file(const std::string& path, const Agent& agent, std::uint16_t robot,
                    std::uint32_t epoch) {
  const ExplorationMap& map = agent.explorer().map();
  const std::string unfinished = path + ".part";
  {
    const File file = open_file(unfinished, "wb", "write the map to");
    FileSink sink(file.get());
    const MapDumpHeader header{robot, epoch, map.frame().cell_um(), map.frame().window()};
    const Status status = write_map_dump(header, OwnRows(map), sink);
    if (!ok(status) || std::fflush(file.get()) != 0) {
      throw std::runtime_error("cannot write the map to " + path + ": " + std::strerror(errno));
    }
  }
  if (std::rename(unfinished.c_str(), path.c_str()) != 0) {
    throw std::runtime_error("cannot write the map to " + path + ": " + std::strerror(errno));
  }
}

}  // namespace ivfm

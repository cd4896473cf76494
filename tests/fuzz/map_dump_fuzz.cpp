#include <vector>

#include "shared/wire/byte_writer.h"
#include "shared/wire/crc.h"
#include "shared/wire/map_dump.h"
#include "tests/fuzz/fuzz_input.h"

namespace {

struct Sink final : ivfm::MapRowSink {
  void take_row(ivfm::Layer, std::int32_t, std::span<const std::uint8_t> cells) override {
    ivfm::fuzz::require(cells.size() <= 4096, "a row is bounded");
  }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ivfm;
  Sink sink;
  static_cast<void>(read_map_dump({data, size}, sink));
  std::vector<std::uint8_t> bytes(data, data + size);  // with a right checksum it goes deeper
  bytes.resize(size + 4);
  ByteWriter(std::span(bytes).last(4)).u32(crc32({data, size}));
  static_cast<void>(read_map_dump(bytes, sink));
  return 0;
}

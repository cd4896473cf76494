#include <algorithm>
#include <array>

#include "shared/wire/map_update.h"
#include "tests/fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ivfm;
  std::array<std::uint8_t, kMaxBlockCells> cells, again;
  std::array<std::uint8_t, kMaxBlockCells + 1> block;
  MapUpdateReader reader({data, size});
  std::size_t total = 0;
  while (true) {
    const auto region = reader.next(cells);
    if (!region.ok()) return 0;
    const auto width = static_cast<std::size_t>(region->rect.width);
    total += region->cells.size();
    fuzz::require(total <= kMaxCellsPerUpdate, "a datagram asks for bounded work");
    const auto encoded = encode_cells(region->cells, width, block);
    fuzz::require(encoded.ok() && *encoded <= region->cells.size() + 1, "never more than raw");
    ByteReader bytes(std::span<const std::uint8_t>(block).first(*encoded));
    const auto decoded = std::span(again).first(region->cells.size());
    fuzz::require(ok(decode_cells(bytes, width, decoded)), "what was encoded decodes");
    fuzz::require(std::ranges::equal(decoded, region->cells), "to the same cells");
  }
}

// Cell blocks: the values of a rectangle of cells in few bytes, decodable in fixed memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "shared/status/status.h"
#include "shared/wire/byte_reader.h"

namespace ivfm {

// Most cells of a block.
inline constexpr std::size_t kMaxBlockCells = 4096;

// The coding of a block (FORMAT.md, "Cell block"): the low three bits of its first byte.
// kPackedRows and kRunRows code the difference of each cell to the one in the row below.
enum class CellCoding : std::uint8_t {
  kRaw = 0,
  kPacked = 1,
  kRuns = 2,
  kPackedRows = 3,
  kRunRows = 4,
};

// Writes `cells` (row by row, `width` to a row) as the shortest of the codings: at most
// cells.size() + 1 bytes. Returns the bytes written. kFull: `out` is too small (its content is then
// undefined); kInvalidArgument: no cells, more than kMaxBlockCells, or no whole number of rows.
Result<std::size_t> encode_cells(std::span<const std::uint8_t> cells, std::size_t width,
                                 std::span<std::uint8_t> out);

// Reads one block of exactly cells.size() cells, `width` to a row. Takes time proportional to
// cells.size() whatever the bytes are. kTruncated: the bytes end early; kCorrupt: they contradict
// themselves; kUnsupported: a coding that this build does not know; kInvalidArgument as above. The
// content of `cells` is undefined after an error.
Status decode_cells(ByteReader& reader, std::size_t width, std::span<std::uint8_t> cells);

}  // namespace ivfm

// The map dump: a robot's own layers in a file, written row by row (FORMAT.md, "Map dump").
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "shared/geometry/grid_frame.h"
#include "shared/status/status.h"
#include "shared/wire/layer.h"

namespace ivfm {

inline constexpr std::array<std::uint8_t, 8> kMapDumpMagic = {'I', 'V', 'F', 'M',
                                                              'D', 'U', 'M', 'P'};
inline constexpr std::uint16_t kMapDumpVersion = 1;
inline constexpr std::int32_t kMaxDumpSide = 4096;

struct MapDumpHeader {
  std::uint16_t robot = 0;
  std::uint32_t epoch = 0;
  std::int32_t cell_um = 0;  // 1 .. 2^24 - 1
  CellRect window;           // sides 1 .. kMaxDumpSide
  constexpr bool operator==(const MapDumpHeader&) const = default;
};

// Where the bytes of a dump go.
class ByteSink {
 public:
  virtual Status write(std::span<const std::uint8_t> bytes) = 0;

 protected:
  ~ByteSink() = default;
};

// Where the rows of a dump come from: `out` is one row of the window, `y` its world row.
class MapRowSource {
 public:
  virtual Status read_row(Layer layer, std::int32_t y, std::span<std::uint8_t> out) const = 0;

 protected:
  ~MapRowSource() = default;
};

// Where the rows of a dump go when it is read.
class MapRowSink {
 public:
  virtual void take_row(Layer layer, std::int32_t y, std::span<const std::uint8_t> cells) = 0;

 protected:
  ~MapRowSink() = default;
};

// Writes a dump of both layers; uses some 8 KiB of stack. kInvalidArgument: a header outside its
// ranges; otherwise what `source` or `sink` answered.
Status write_map_dump(const MapDumpHeader& header, const MapRowSource& source, ByteSink& sink);

// Reads a whole dump; rows go to `sink` after the checksum has been found right. kTruncated: the
// bytes end early; kCorrupt: no dump, a wrong checksum or impossible content; kUnsupported: another
// version.
Result<MapDumpHeader> read_map_dump(std::span<const std::uint8_t> bytes, MapRowSink& sink);

}  // namespace ivfm

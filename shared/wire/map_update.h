// The body of a map update: rectangles of absolute cell values (FORMAT.md, "Map update").
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "shared/geometry/grid_frame.h"
#include "shared/status/status.h"
#include "shared/wire/byte_reader.h"
#include "shared/wire/byte_writer.h"
#include "shared/wire/cell_codec.h"
#include "shared/wire/float16.h"
#include "shared/wire/layer.h"

namespace ivfm {

// Sides of a region: 1 .. 255 cells, and at most kMaxBlockCells cells.
inline constexpr std::int32_t kMaxRegionSide = 255;
// Cell numbers on the wire have 24 bits.
inline constexpr std::int32_t kMaxCellNumber = 0x7fffff;
inline constexpr std::int32_t kMinCellNumber = -0x800000;
inline constexpr std::size_t kRegionHeaderBytes = 9;
// Bounds the work that one datagram can ask for.
inline constexpr std::size_t kMaxRegionsPerUpdate = 64;
inline constexpr std::size_t kMaxCellsPerUpdate = 32768;

// True when a rectangle can be one region.
constexpr bool is_valid_region(const CellRect& rect) {
  return rect.width >= 1 && rect.width <= kMaxRegionSide && rect.height >= 1 &&
         rect.height <= kMaxRegionSide &&
         rect.area() <= static_cast<std::int64_t>(kMaxBlockCells) && rect.x >= kMinCellNumber &&
         rect.y >= kMinCellNumber && rect.x <= kMaxCellNumber - rect.width &&
         rect.y <= kMaxCellNumber - rect.height;
}

// Writes regions into the body of a datagram until it is full.
class MapUpdateWriter {
 public:
  // `cell_um`: side of a cell, 1 .. 2^24 - 1 micrometres. `pose`: the sender's when it sent.
  MapUpdateWriter(std::span<std::uint8_t> body, std::int32_t cell_um, const PackedPose& pose);

  // Appends a region; `cells` row by row from the lowest. kFull: does not fit into what is left
  // (the body is as before); kInvalidArgument: not a valid region or a wrong number of cells.
  Status add(Layer layer, const CellRect& rect, std::span<const std::uint8_t> cells);

  std::size_t size() const { return writer_.size(); }
  std::size_t regions() const { return regions_; }

 private:
  ByteWriter writer_;
  std::size_t regions_ = 0;
  std::size_t cells_ = 0;
};

// A region as read: `cells` lies in the buffer given to next().
struct Region {
  Layer layer = Layer::kVisits;
  CellRect rect;
  std::span<const std::uint8_t> cells;
  std::size_t wire_bytes = 0;  // of the region in the datagram
};

// Reads the regions of a body one by one.
class MapUpdateReader {
 public:
  explicit MapUpdateReader(std::span<const std::uint8_t> body);

  std::int32_t cell_um() const { return cell_um_; }
  const PackedPose& pose() const { return pose_; }

  // The next region, its cells decoded into `buffer` (at least kMaxBlockCells). kEmpty: that was
  // all; kTruncated, kCorrupt, kUnsupported: the body is bad from here on; kOutOfRange: more
  // regions or cells than a datagram may have, or a rectangle that is not a valid region;
  // kInvalidArgument: `buffer` is too small.
  Result<Region> next(std::span<std::uint8_t> buffer);

 private:
  ByteReader reader_;
  std::int32_t cell_um_ = 0;
  PackedPose pose_;
  std::size_t regions_ = 0;
  std::size_t cells_ = 0;
};

// kOk when every region of the body can be read and its cell size is not 0; otherwise what next()
// would say. `buffer` as for next().
Status check_map_update(std::span<const std::uint8_t> body, std::span<std::uint8_t> buffer);

}  // namespace ivfm

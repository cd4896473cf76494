#include "shared/wire/map_update.h"

namespace ivfm {

MapUpdateWriter::MapUpdateWriter(std::span<std::uint8_t> body, std::int32_t cell_um,
                                 const PackedPose& pose)
    : writer_(body) {
  writer_.u24(static_cast<std::uint32_t>(cell_um));
  writer_.u16(pose.x);
  writer_.u16(pose.y);
  writer_.u16(pose.heading);
}

Status MapUpdateWriter::add(Layer layer, const CellRect& rect,
                            std::span<const std::uint8_t> cells) {
  if (!is_valid_region(rect) || cells.size() != static_cast<std::size_t>(rect.area())) {
    return Status::kInvalidArgument;
  }
  if (!writer_.ok() || regions_ == kMaxRegionsPerUpdate) return Status::kFull;
  if (cells.size() > kMaxCellsPerUpdate - cells_) return Status::kFull;
  const auto rest = writer_.rest();
  if (rest.size() <= kRegionHeaderBytes) return Status::kFull;
  // The block first: when it does not fit, nothing has been written.
  const auto block =
      encode_cells(cells, static_cast<std::size_t>(rect.width), rest.subspan(kRegionHeaderBytes));
  if (!block.ok()) return block.status();
  writer_.u8(static_cast<std::uint8_t>(layer));
  writer_.i24(rect.x);
  writer_.i24(rect.y);
  writer_.u8(static_cast<std::uint8_t>(rect.width));
  writer_.u8(static_cast<std::uint8_t>(rect.height));
  writer_.skip(*block);
  ++regions_;
  cells_ += cells.size();
  return Status::kOk;
}

MapUpdateReader::MapUpdateReader(std::span<const std::uint8_t> body) : reader_(body) {
  cell_um_ = static_cast<std::int32_t>(reader_.u24());
  pose_.x = reader_.u16();
  pose_.y = reader_.u16();
  pose_.heading = reader_.u16();
}

Result<Region> MapUpdateReader::next(std::span<std::uint8_t> buffer) {
  if (buffer.size() < kMaxBlockCells) return Status::kInvalidArgument;
  if (!reader_.ok()) return Status::kTruncated;
  if (reader_.remaining() == 0) return Status::kEmpty;
  Region region;
  const std::size_t before = reader_.remaining();
  const std::uint8_t layer = reader_.u8();
  region.rect.x = reader_.i24();
  region.rect.y = reader_.i24();
  region.rect.width = reader_.u8();
  region.rect.height = reader_.u8();
  if (!reader_.ok()) return Status::kTruncated;
  if (layer >= kLayerCount) return Status::kUnsupported;
  region.layer = static_cast<Layer>(layer);
  if (!is_valid_region(region.rect)) return Status::kOutOfRange;
  const auto count = static_cast<std::size_t>(region.rect.area());
  if (regions_ == kMaxRegionsPerUpdate || count > kMaxCellsPerUpdate - cells_) {
    return Status::kOutOfRange;
  }
  const auto cells = buffer.first(count);
  const Status status = decode_cells(reader_, static_cast<std::size_t>(region.rect.width), cells);
  if (!ok(status)) return status;
  ++regions_;
  cells_ += count;
  region.cells = cells;
  region.wire_bytes = before - reader_.remaining();
  return region;
}

Status check_map_update(std::span<const std::uint8_t> body, std::span<std::uint8_t> buffer) {
  MapUpdateReader reader(body);
  while (true) {
    const auto region = reader.next(buffer);
    if (region.ok()) continue;
    if (region.status() != Status::kEmpty) return region.status();
    return reader.cell_um() == 0 ? Status::kCorrupt : Status::kOk;
  }
}

}  // namespace ivfm

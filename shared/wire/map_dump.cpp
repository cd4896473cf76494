#include "shared/wire/map_dump.h"

#include <algorithm>

#include "shared/wire/byte_reader.h"
#include "shared/wire/byte_writer.h"
#include "shared/wire/cell_codec.h"
#include "shared/wire/crc.h"

namespace ivfm {
namespace {

constexpr std::size_t kCrcBytes = 4;
constexpr std::size_t kHeaderBytes = 8 + 2 + 2 + 4 + 3 + 4 + 4 + 2 + 2 + 1;
static_assert(kMaxDumpSide <= static_cast<std::int32_t>(kMaxBlockCells));

bool is_valid(const MapDumpHeader& header) {
  constexpr std::int32_t kFarthest = 1 << 30;
  const CellRect& w = header.window;
  return header.cell_um > 0 && header.cell_um < (1 << 24) && w.width >= 1 &&
         w.width <= kMaxDumpSide && w.height >= 1 && w.height <= kMaxDumpSide &&
         w.x >= -kFarthest && w.x <= kFarthest && w.y >= -kFarthest && w.y <= kFarthest;
}

// Passes bytes on and keeps their checksum.
class ChecksummedSink {
 public:
  explicit ChecksummedSink(ByteSink& sink) : sink_(sink) {}
  Status write(std::span<const std::uint8_t> bytes) {
    crc_ = crc32(bytes, crc_);
    return sink_.write(bytes);
  }
  Status finish() {
    std::array<std::uint8_t, kCrcBytes> trailer{};
    ByteWriter writer(trailer);
    writer.u32(crc_);
    return sink_.write(trailer);
  }

 private:
  ByteSink& sink_;
  std::uint32_t crc_ = 0;
};

Status write_header(const MapDumpHeader& header, ChecksummedSink& sink) {
  std::array<std::uint8_t, kHeaderBytes> bytes{};
  ByteWriter writer(bytes);
  writer.bytes(kMapDumpMagic);
  writer.u16(kMapDumpVersion);
  writer.u16(header.robot);
  writer.u32(header.epoch);
  writer.u24(static_cast<std::uint32_t>(header.cell_um));
  writer.i32(header.window.x);
  writer.i32(header.window.y);
  writer.u16(static_cast<std::uint16_t>(header.window.width));
  writer.u16(static_cast<std::uint16_t>(header.window.height));
  writer.u8(static_cast<std::uint8_t>(kLayerCount));
  return sink.write(bytes);
}

Status write_row(Layer layer, std::int32_t y, std::size_t width, const MapRowSource& source,
                 ChecksummedSink& sink) {
  std::array<std::uint8_t, kMaxBlockCells> cells;
  std::array<std::uint8_t, kMaxBlockCells + 1> block;
  const auto row = std::span(cells).first(width);
  if (const Status status = source.read_row(layer, y, row); !ok(status)) return status;
  const auto size = encode_cells(row, width, block);
  if (!size.ok()) return size.status();
  return sink.write(std::span(block).first(*size));
}

Result<MapDumpHeader> read_header(ByteReader& reader) {
  const auto magic = reader.bytes(kMapDumpMagic.size());
  if (!reader.ok()) return Status::kTruncated;
  if (!std::equal(magic.begin(), magic.end(), kMapDumpMagic.begin())) return Status::kCorrupt;
  const std::uint16_t version = reader.u16();
  if (!reader.ok()) return Status::kTruncated;
  if (version != kMapDumpVersion) return Status::kUnsupported;
  MapDumpHeader header;
  header.robot = reader.u16();
  header.epoch = reader.u32();
  header.cell_um = static_cast<std::int32_t>(reader.u24());
  header.window.x = reader.i32();
  header.window.y = reader.i32();
  header.window.width = reader.u16();
  header.window.height = reader.u16();
  const std::uint8_t layers = reader.u8();
  if (!reader.ok()) return Status::kTruncated;
  if (!is_valid(header) || layers != kLayerCount) return Status::kCorrupt;
  return header;
}

Status read_rows(const MapDumpHeader& header, ByteReader& reader, MapRowSink& sink) {
  std::array<std::uint8_t, kMaxBlockCells> cells;
  const auto width = static_cast<std::size_t>(header.window.width);
  const auto row = std::span(cells).first(width);
  for (std::size_t layer = 0; layer < kLayerCount; ++layer) {
    for (std::int32_t y = header.window.y; y < header.window.top(); ++y) {
      if (const Status status = decode_cells(reader, width, row); !ok(status)) return status;
      sink.take_row(static_cast<Layer>(layer), y, row);
    }
  }
  return reader.remaining() == 0 ? Status::kOk : Status::kCorrupt;
}

}  // namespace

Status write_map_dump(const MapDumpHeader& header, const MapRowSource& source, ByteSink& sink) {
  if (!is_valid(header)) return Status::kInvalidArgument;
  ChecksummedSink checksummed(sink);
  if (const Status status = write_header(header, checksummed); !ok(status)) return status;
  const auto width = static_cast<std::size_t>(header.window.width);
  for (std::size_t layer = 0; layer < kLayerCount; ++layer) {
    for (std::int32_t y = header.window.y; y < header.window.top(); ++y) {
      const Status status = write_row(static_cast<Layer>(layer), y, width, source, checksummed);
      if (!ok(status)) return status;
    }
  }
  return checksummed.finish();
}

Result<MapDumpHeader> read_map_dump(std::span<const std::uint8_t> bytes, MapRowSink& sink) {
  if (bytes.size() < kHeaderBytes + kCrcBytes) return Status::kTruncated;
  const auto covered = bytes.first(bytes.size() - kCrcBytes);
  ByteReader reader(covered);
  const auto header = read_header(reader);
  if (!header.ok()) return header;
  if (ByteReader(bytes.last(kCrcBytes)).u32() != crc32(covered)) return Status::kCorrupt;
  if (const Status status = read_rows(*header, reader, sink); !ok(status)) return status;
  return header;
}

}  // namespace ivfm

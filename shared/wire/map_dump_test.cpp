#include "shared/wire/map_dump.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "shared/wire/crc.h"

namespace ivfm {
namespace {

using Bytes = std::vector<std::uint8_t>;
constexpr MapDumpHeader kHeader{3, 17, 15625, {-4, 6, 5, 3}};

// Cell (x, y): a value that says which cell and layer it is.
std::uint8_t value_at(Layer layer, std::int32_t x, std::int32_t y) {
  return layer == Layer::kVisits ? static_cast<std::uint8_t>((x * 10 + y) & 0xff)
                                 : static_cast<std::uint8_t>((x + y) & 1);
}

struct PatternSource final : MapRowSource {
  Status read_row(Layer layer, std::int32_t y, std::span<std::uint8_t> out) const override {
    for (std::size_t i = 0; i < out.size(); ++i) {
      out[i] = value_at(layer, kHeader.window.x + static_cast<std::int32_t>(i), y);
    }
    return Status::kOk;
  }
};

struct VectorSink final : ByteSink {
  Bytes bytes;
  Status write(std::span<const std::uint8_t> more) override {
    bytes.insert(bytes.end(), more.begin(), more.end());
    return Status::kOk;
  }
};

struct CheckingSink final : MapRowSink {
  int rows = 0;
  void take_row(Layer layer, std::int32_t y, std::span<const std::uint8_t> cells) override {
    ++rows;
    EXPECT_EQ(cells.size(), 5u);
    for (std::size_t i = 0; i < cells.size(); ++i) {
      EXPECT_EQ(cells[i], value_at(layer, kHeader.window.x + static_cast<std::int32_t>(i), y));
    }
  }
};

struct IgnoringSink final : MapRowSink {
  void take_row(Layer, std::int32_t, std::span<const std::uint8_t>) override {}
};

Bytes dump() {
  VectorSink sink;
  EXPECT_EQ(write_map_dump(kHeader, PatternSource{}, sink), Status::kOk);
  return sink.bytes;
}

TEST(MapDump, SurvivesTheRoundTrip) {
  CheckingSink sink;
  const auto header = read_map_dump(dump(), sink);
  ASSERT_TRUE(header.ok());
  EXPECT_EQ(*header, kHeader);
  EXPECT_EQ(sink.rows, 6);
}

TEST(MapDump, RefusesAHeaderOutsideItsRanges) {
  VectorSink sink;
  MapDumpHeader wide = kHeader;
  wide.window.width = kMaxDumpSide + 1;
  EXPECT_EQ(write_map_dump(wide, PatternSource{}, sink), Status::kInvalidArgument);
  MapDumpHeader no_cells = kHeader;
  no_cells.cell_um = 0;
  EXPECT_EQ(write_map_dump(no_cells, PatternSource{}, sink), Status::kInvalidArgument);
  EXPECT_TRUE(sink.bytes.empty());
}

TEST(MapDump, CutOrFlippedFilesAreRefused) {
  const Bytes good = dump();
  IgnoringSink sink;
  for (std::size_t size = 0; size < good.size(); ++size) {
    ASSERT_FALSE(read_map_dump(std::span(good).first(size), sink).ok());
  }
  for (std::size_t bit = 0; bit < good.size() * 8; ++bit) {
    Bytes bad = good;
    bad[bit / 8] = static_cast<std::uint8_t>(bad[bit / 8] ^ (1u << (bit % 8)));
    ASSERT_FALSE(read_map_dump(bad, sink).ok()) << bit;
  }
  EXPECT_EQ(read_map_dump(Bytes(100, 0x20), sink).status(), Status::kCorrupt);
}

TEST(MapDump, RandomFilesNeverHarm) {
  std::mt19937 random(1);
  IgnoringSink sink;
  for (int round = 0; round < 20000; ++round) {
    Bytes bytes = dump();
    bytes.erase(bytes.end() - 4, bytes.end());
    for (std::size_t i = 10; i < bytes.size(); ++i) {
      if (random() % 16 == 0) bytes[i] = static_cast<std::uint8_t>(random() & 0xffu);
    }
    const std::uint32_t crc = crc32(bytes);  // a right checksum lets the content be looked at
    for (int shift = 0; shift < 32; shift += 8) {
      bytes.push_back(static_cast<std::uint8_t>(crc >> shift));
    }
    static_cast<void>(read_map_dump(bytes, sink));
  }
}

}  // namespace
}  // namespace ivfm

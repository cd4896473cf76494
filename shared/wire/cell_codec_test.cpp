#include "shared/wire/cell_codec.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>
#include <vector>

namespace ivfm {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes encoded(const Bytes& cells, std::size_t width) {
  Bytes out(cells.size() + 1);
  const auto size = encode_cells(cells, width, out);
  EXPECT_TRUE(size.ok());
  out.resize(size.ok() ? *size : 0);
  return out;
}

Status decoded(const Bytes& block, std::size_t width, Bytes& cells) {
  ByteReader reader(block);
  return decode_cells(reader, width, cells);
}

void expect_round_trip(const Bytes& cells, std::size_t width) {
  const Bytes block = encoded(cells, width);
  ASSERT_LE(block.size(), cells.size() + 1);
  Bytes back(cells.size());
  ByteReader reader(block);
  ASSERT_EQ(decode_cells(reader, width, back), Status::kOk);
  ASSERT_EQ(reader.remaining(), 0u);
  ASSERT_EQ(back, cells);
}

// What maps look like: nothing, one value, blobs of small counts, walls, and noise.
Bytes random_cells(std::mt19937& random, std::size_t width, std::size_t height) {
  Bytes cells(width * height);
  const auto kind = random() % 5;
  const auto fill = static_cast<std::uint8_t>(random() % 4);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const std::size_t x = i % width, y = i / width;
    if (kind == 0) cells[i] = fill;
    if (kind == 1) cells[i] = static_cast<std::uint8_t>((x / 7 + y / 5) % 3);
    if (kind == 2) cells[i] = x == width / 2 || y == 0 ? 1 : 0;
    if (kind == 3) cells[i] = static_cast<std::uint8_t>(random() & 0xffu);
    if (kind == 4) cells[i] = static_cast<std::uint8_t>(250 + x % 6);
  }
  return cells;
}

TEST(CellCodec, AnEmptyRectangleTakesOneByte) {
  EXPECT_EQ(encoded(Bytes(4096, 0), 64), (Bytes{0x01}));
}

TEST(CellCodec, SmallCountsArePackedFromTheLowestBit) {
  // Two bits a cell: 0 1 1 0, 0 1 2 1, 0 1 1 0 (the worked example of FORMAT.md).
  EXPECT_EQ(encoded({0, 1, 1, 0, 0, 1, 2, 1, 0, 1, 1, 0}, 4), (Bytes{0x11, 0x14, 0x64, 0x14}));
}

TEST(CellCodec, LongRunsAreCodedByTheirLength) {
  Bytes cells(24, 0);
  std::fill(cells.begin() + 10, cells.end(), std::uint8_t{1});
  EXPECT_EQ(encoded(cells, 24), (Bytes{0x0a, 0x50, 0xd1}));
}

TEST(CellCodec, RowsThatRepeatCostOneRunOfDifferences) {
  Bytes cells;
  for (int row = 0; row < 16; ++row) {
    for (std::uint8_t x = 0; x < 16; ++x) cells.push_back(static_cast<std::uint8_t>(x * 37 + 5));
  }
  const Bytes block = encoded(cells, 16);
  EXPECT_EQ(block[0] & 7u, static_cast<unsigned>(CellCoding::kRunRows));
  EXPECT_LT(block.size(), 32u);
  expect_round_trip(cells, 16);
}

TEST(CellCodec, NoiseIsSentRawWithOneByteMore) {
  std::mt19937 random(1);
  Bytes cells(1000);
  for (auto& cell : cells) cell = static_cast<std::uint8_t>(random() & 0xffu);
  const Bytes block = encoded(cells, 50);
  EXPECT_EQ(block[0], 0x00);
  EXPECT_EQ(block.size(), 1001u);
}

TEST(CellCodec, RandomRectanglesSurviveTheRoundTrip) {
  std::mt19937 random(2);
  for (int round = 0; round < 3000; ++round) {
    const std::size_t width = 1 + random() % 100;
    const std::size_t height = 1 + random() % std::min<std::size_t>(100, kMaxBlockCells / width);
    expect_round_trip(random_cells(random, width, height), width);
  }
}

TEST(CellCodec, TheLongestRunFits) { expect_round_trip(Bytes(kMaxBlockCells, 255), 64); }

TEST(CellCodec, RefusesImpossibleShapesAndTooLittleRoom) {
  Bytes out(10);
  EXPECT_EQ(encode_cells({}, 1, out).status(), Status::kInvalidArgument);
  EXPECT_EQ(encode_cells(Bytes(5), 2, out).status(), Status::kInvalidArgument);
  EXPECT_EQ(encode_cells(Bytes(5), 0, out).status(), Status::kInvalidArgument);
  EXPECT_EQ(encode_cells(Bytes(4097), 1, out).status(), Status::kInvalidArgument);
  EXPECT_EQ(encode_cells(Bytes{1, 2, 3, 200, 5}, 5, std::span(out).first(5)).status(),
            Status::kFull);
}

TEST(CellCodec, EveryCutBlockIsTruncated) {
  std::mt19937 random(3);
  for (int round = 0; round < 200; ++round) {
    const Bytes cells = random_cells(random, 20, 10);
    const Bytes block = encoded(cells, 20);
    for (std::size_t size = 0; size < block.size(); ++size) {
      Bytes back(cells.size());
      ASSERT_EQ(decoded(Bytes(block.begin(), block.begin() + static_cast<std::ptrdiff_t>(size)), 20,
                        back),
                Status::kTruncated);
    }
  }
}

TEST(CellCodec, NamesWhatIsWrongWithABlock) {
  Bytes cells(8);
  EXPECT_EQ(decoded({0x05}, 8, cells), Status::kUnsupported);       // coding 5
  EXPECT_EQ(decoded({0x41, 0}, 8, cells), Status::kCorrupt);        // packed in 8 bits
  EXPECT_EQ(decoded({0x02, 0}, 8, cells), Status::kCorrupt);        // runs of no bits
  EXPECT_EQ(decoded({0x4a, 0}, 8, cells), Status::kCorrupt);        // runs of 9 bits
  EXPECT_EQ(decoded({0x08, 0}, 8, cells), Status::kCorrupt);        // raw with a width
  EXPECT_EQ(decoded({0x0a, 0x21, 0}, 8, cells), Status::kCorrupt);  // a run of 16 in 8 cells
  EXPECT_EQ(decoded({0x0a, 0, 0, 0}, 8, cells), Status::kCorrupt);  // a length without an end
  Bytes three(3);
  EXPECT_EQ(decoded({0x09, 0x0f}, 3, three), Status::kCorrupt);  // padding that is not 0
  EXPECT_EQ(decoded({0x09, 0x07}, 3, three), Status::kOk);
}

TEST(CellCodec, RandomBytesNeverHarm) {
  std::mt19937 random(4);
  for (int round = 0; round < 100000; ++round) {
    Bytes block(random() % 40);
    for (auto& byte : block) byte = static_cast<std::uint8_t>(random() & 0xffu);
    const std::size_t width = 1 + random() % 16;
    Bytes cells(width * (1 + random() % 16));
    ByteReader reader(block);
    static_cast<void>(decode_cells(reader, width, cells));
    ASSERT_LE(reader.remaining(), block.size());
  }
}

}  // namespace
}  // namespace ivfm

#include "shared/wire/map_update.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>
#include <vector>

#include "shared/wire/datagram.h"

namespace ivfm {
namespace {

using Bytes = std::vector<std::uint8_t>;
constexpr PackedPose kPose{0x3e00, 0xc000, 0x3e48};

struct Written {
  Layer layer;
  CellRect rect;
  Bytes cells;
};

Written random_region(std::mt19937& random) {
  Written region;
  region.layer = random() % 2 ? Layer::kVisits : Layer::kObstacles;
  const auto width = static_cast<std::int32_t>(1 + random() % 40);
  const auto height = static_cast<std::int32_t>(1 + random() % 40);
  region.rect = {static_cast<std::int32_t>(random() % 100000) - 50000,
                 static_cast<std::int32_t>(random() % 100000) - 50000, width, height};
  region.cells.resize(static_cast<std::size_t>(region.rect.area()));
  for (auto& cell : region.cells) cell = static_cast<std::uint8_t>(random() % 4 == 0 ? 1 : 0);
  return region;
}

Bytes write_until_full(std::mt19937& random, std::vector<Written>& written) {
  Bytes body(kMaxBodyBytes);
  MapUpdateWriter writer(body, 50000, kPose);
  while (true) {
    Written region = random_region(random);
    const Status status = writer.add(region.layer, region.rect, region.cells);
    if (status == Status::kFull) break;
    EXPECT_EQ(status, Status::kOk);
    written.push_back(std::move(region));
  }
  EXPECT_EQ(writer.regions(), written.size());
  body.resize(writer.size());
  return body;
}

TEST(MapUpdate, RandomRegionsSurviveTheRoundTrip) {
  std::mt19937 random(1);
  std::array<std::uint8_t, kMaxBlockCells> buffer;
  for (int round = 0; round < 200; ++round) {
    std::vector<Written> written;
    const Bytes body = write_until_full(random, written);
    ASSERT_EQ(check_map_update(body, buffer), Status::kOk);
    MapUpdateReader reader(body);
    EXPECT_EQ(reader.cell_um(), 50000);
    EXPECT_EQ(reader.pose(), kPose);
    for (const Written& expected : written) {
      const auto region = reader.next(buffer);
      ASSERT_TRUE(region.ok());
      ASSERT_EQ(region->layer, expected.layer);
      ASSERT_EQ(region->rect, expected.rect);
      ASSERT_TRUE(std::ranges::equal(region->cells, expected.cells));
    }
    ASSERT_EQ(reader.next(buffer).status(), Status::kEmpty);
  }
}

TEST(MapUpdate, ARegionThatDoesNotFitLeavesTheBodyAsItWas) {
  std::mt19937 random(2);
  Bytes body(200);
  MapUpdateWriter writer(body, 50000, kPose);
  Bytes noise(150);
  for (auto& cell : noise) cell = static_cast<std::uint8_t>(random() & 0xffu);
  ASSERT_EQ(writer.add(Layer::kVisits, {0, 0, 15, 10}, noise), Status::kOk);
  const std::size_t size = writer.size();
  EXPECT_EQ(writer.add(Layer::kVisits, {0, 0, 15, 10}, noise), Status::kFull);
  EXPECT_EQ(writer.size(), size);
  EXPECT_EQ(writer.add(Layer::kVisits, {0, 0, 2, 1}, Bytes{1, 1}), Status::kOk);
}

TEST(MapUpdate, RefusesWhatIsNoRegion) {
  Bytes body(kMaxBodyBytes);
  MapUpdateWriter writer(body, 50000, kPose);
  EXPECT_EQ(writer.add(Layer::kVisits, {0, 0, 0, 1}, {}), Status::kInvalidArgument);
  EXPECT_EQ(writer.add(Layer::kVisits, {0, 0, 2, 2}, Bytes(3)), Status::kInvalidArgument);
  EXPECT_EQ(writer.add(Layer::kVisits, {0, 0, 256, 1}, Bytes(256)), Status::kInvalidArgument);
  EXPECT_EQ(writer.add(Layer::kVisits, {0, 0, 100, 100}, Bytes(10000)), Status::kInvalidArgument);
  EXPECT_EQ(writer.add(Layer::kVisits, {kMaxCellNumber, 0, 1, 1}, Bytes(1)),
            Status::kInvalidArgument);
  EXPECT_EQ(writer.add(Layer::kVisits, {kMinCellNumber - 1, 0, 1, 1}, Bytes(1)),
            Status::kInvalidArgument);
  EXPECT_EQ(writer.add(Layer::kVisits, {kMinCellNumber, kMaxCellNumber - 1, 1, 1}, Bytes(1)),
            Status::kOk);
}

TEST(MapUpdate, OneDatagramCannotAskForMoreWorkThanTheLimits) {
  std::array<std::uint8_t, kMaxBlockCells> buffer;
  Bytes body(9, 1);
  for (int i = 0; i < 9; ++i) {  // nine empty blocks of 4,096 cells in ten bytes each
    const Bytes region = {0, 0, 0, 0, 0, 0, 0, 64, 64, 0x01};
    body.insert(body.end(), region.begin(), region.end());
  }
  EXPECT_EQ(check_map_update(body, buffer), Status::kOutOfRange);
  body.resize(body.size() - 10);
  EXPECT_EQ(check_map_update(body, buffer), Status::kOk);

  Bytes small(9, 1);
  for (int i = 0; i < 65; ++i) {
    const Bytes region = {0, 0, 0, 0, 0, 0, 0, 1, 1, 0x01};
    small.insert(small.end(), region.begin(), region.end());
  }
  EXPECT_EQ(check_map_update(small, buffer), Status::kOutOfRange);
}

TEST(MapUpdate, NamesWhatIsWrong) {
  std::array<std::uint8_t, kMaxBlockCells> buffer;
  const Bytes head = {1, 0, 0, 0, 0, 0, 0, 0, 0};
  const auto with = [&](Bytes region) {
    Bytes body = head;
    body.insert(body.end(), region.begin(), region.end());
    return check_map_update(body, buffer);
  };
  EXPECT_EQ(with({}), Status::kOk);
  EXPECT_EQ(with({0, 0, 0, 0, 0, 0, 0, 1}), Status::kTruncated);
  EXPECT_EQ(with({2, 0, 0, 0, 0, 0, 0, 1, 1, 1}), Status::kUnsupported);  // layer 2
  EXPECT_EQ(with({0, 0, 0, 0, 0, 0, 0, 0, 1, 1}), Status::kOutOfRange);   // no columns
  EXPECT_EQ(with({0, 0xff, 0xff, 0x7f, 0, 0, 0, 1, 1, 1}), Status::kOutOfRange);
  EXPECT_EQ(with({0, 0, 0, 0, 0, 0, 0, 65, 64, 1}), Status::kOutOfRange);  // 4,160 cells
  EXPECT_EQ(with({0, 0, 0, 0, 0, 0, 0, 1, 1, 0x05}), Status::kUnsupported);
  EXPECT_EQ(check_map_update(Bytes(8), buffer), Status::kTruncated);
  EXPECT_EQ(check_map_update(Bytes(9), buffer), Status::kCorrupt);  // cells of 0 um
  MapUpdateReader reader(head);
  EXPECT_EQ(reader.next(std::span(buffer).first(10)).status(), Status::kInvalidArgument);
}

TEST(MapUpdate, CutFlippedAndRandomBodiesNeverHarm) {
  std::mt19937 random(3);
  std::array<std::uint8_t, kMaxBlockCells> buffer;
  std::vector<Written> written;
  const Bytes good = write_until_full(random, written);
  for (std::size_t size = 0; size < good.size(); ++size) {
    static_cast<void>(check_map_update(std::span(good).first(size), buffer));
  }
  for (int round = 0; round < 20000; ++round) {
    Bytes bad = good;
    const std::size_t bit = random() % (bad.size() * 8);
    bad[bit / 8] = static_cast<std::uint8_t>(bad[bit / 8] ^ (1u << (bit % 8)));
    static_cast<void>(check_map_update(bad, buffer));
    Bytes noise(random() % 100);
    for (auto& byte : noise) byte = static_cast<std::uint8_t>(random() & 0xffu);
    static_cast<void>(check_map_update(noise, buffer));
  }
}

}  // namespace
}  // namespace ivfm

#include "firmware/nn/state_encoder.h"

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <vector>

namespace ivfm {
namespace {

// A map drawn as text, its top row first: '0'..'9' visits, '#' obstacle.
struct DrawnMap {
  explicit DrawnMap(const std::vector<std::string>& rows, std::int32_t cell_um = 1000)
      : frame(cell_um, {0, 0, static_cast<int>(rows[0].size()), static_cast<int>(rows.size())}),
        own(frame.size()),
        peers(frame.size()),
        flags(frame.size()) {
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) {
        const char c =
            rows[static_cast<std::size_t>(frame.height() - 1 - y)][static_cast<std::size_t>(x)];
        const std::size_t i = frame.index_of({x, y});
        if (c == '#') flags[i] = 2;
        if (c >= '0' && c <= '9') own[i] = static_cast<std::uint8_t>(c - '0');
      }
  }
  VisitView view() const { return {frame, own, peers, flags, 3}; }

  GridFrame frame;
  std::vector<std::uint8_t> own, peers, flags;
};

constexpr Point kFarAway{1'000'000'000, 1'000'000'000};

std::vector<std::uint16_t> encode(const DrawnMap& map, const PolicyGrid& grid,
                                  Point robot = kFarAway, std::int32_t radius_um = 0) {
  std::vector<std::uint16_t> out(kPolicyGridSize);
  EXPECT_EQ(encode_ivfm(map.view(), grid, robot, radius_um, out), Status::kOk);
  return out;
}

TEST(IvfmTable, FollowsThePapersEquation) {
  // 10 * sigma(v) * 4096: sigma(0) = 1/2, sigma(1) = 0.731058579, sigma(2) = 0.880797078,
  // sigma(5) = 0.993307149; sigma(12) = 0.99999386 misses 40960 by 0.25.
  EXPECT_EQ(kIvfmOfVisits[0], 20480);
  EXPECT_EQ(kIvfmOfVisits[1], 29944);  // 29944.16
  EXPECT_EQ(kIvfmOfVisits[2], 36077);  // 36077.45
  EXPECT_EQ(kIvfmOfVisits[5], 40686);  // 40685.86
  EXPECT_EQ(kIvfmOfVisits[12], 40960);
  EXPECT_EQ(kIvfmOfVisits[255], 40960);
  EXPECT_EQ(kIvfmBlocked, 49152);  // (10 + 2) * 4096
}

TEST(PolicyGrid, PutsTheRobotsCellInTheLowerLeftOfPolicyCell16) {
  const PolicyGrid grid = PolicyGrid::centred_on({-5, 7}, 2);
  EXPECT_EQ(grid.window(), (CellRect{-37, -25, 64, 64}));
  EXPECT_EQ(grid.index_of({-5, 7}), 16 * 32 + 16);
  EXPECT_EQ(grid.index_of({-4, 8}), 16 * 32 + 16);
  EXPECT_EQ(grid.index_of({-6, 7}), 16 * 32 + 15);
  EXPECT_EQ(grid.index_of({-37, -25}), 0);
  EXPECT_EQ(grid.index_of({-38, -25}), -1);
  EXPECT_EQ(grid.index_of({27, 0}), -1);
  EXPECT_EQ(grid.block(16 * 32 + 16), (CellRect{-5, 7, 2, 2}));
}

TEST(EncodeIvfm, MapsVisitsObstaclesAndUnknownCells) {
  const DrawnMap map({"2#.",  //
                      "015"});
  const auto out = encode(map, {{0, 0}, 1});
  EXPECT_EQ(out[0], 20480);
  EXPECT_EQ(out[1], 29944);
  EXPECT_EQ(out[2], 40686);
  EXPECT_EQ(out[32], 36077);
  EXPECT_EQ(out[33], 49152);
  EXPECT_EQ(out[34], 20480);
  EXPECT_EQ(out[3], 20480);  // outside the window: unknown
  EXPECT_EQ(out[64], 20480);
}

TEST(EncodeIvfm, AddsThePeersVisitsAndSaturates) {
  DrawnMap map({"1000"});
  map.peers = {1, 2, 255, 0};
  map.own[2] = 255;
  const auto out = encode(map, {{0, 0}, 1});
  EXPECT_EQ(out[0], kIvfmOfVisits[2]);
  EXPECT_EQ(out[1], kIvfmOfVisits[2]);
  EXPECT_EQ(out[2], 40960);
  EXPECT_EQ(out[3], 20480);
}

TEST(EncodeIvfm, IgnoresFlagsThatAreNotObstacles) {
  DrawnMap map({"00"});
  map.flags = {4, 1};
  const auto out = encode(map, {{0, 0}, 1});
  EXPECT_EQ(out[0], 20480);
  EXPECT_EQ(out[1], 49152);
}

TEST(EncodeIvfm, PoolsByTheRoundedMean) {
  const DrawnMap map({"0#11",  //
                      "0012"});
  const auto out = encode(map, {{0, 0}, 2});
  EXPECT_EQ(out[0], (3 * 20480 + 49152 + 2) / 4);
  EXPECT_EQ(out[1], 31477);  // (3 * 29944 + 36077) / 4 = 31477.25
  EXPECT_EQ(out[2], 20480);
}

TEST(EncodeIvfm, DrawsTheRobotsDiscByCellCentres) {
  const DrawnMap map({"00000",  //
                      "00000",  //
                      "00000",  //
                      "00000",  //
                      "00000"});
  // Cells of 1 mm, the robot in the middle of cell (2, 2), radius 1.4 mm: a plus of five cells.
  const auto out = encode(map, {{0, 0}, 1}, {2500, 2500}, 1400);
  const std::vector<std::string> expected = {".....",  //
                                             "..R..",  //
                                             ".RRR.",  //
                                             "..R..",  //
                                             "....."};
  for (std::size_t y = 0; y < 5; ++y)
    for (std::size_t x = 0; x < 5; ++x)
      EXPECT_EQ(out[y * 32 + x], expected[4 - y][x] == 'R' ? 49152 : 20480) << x << ' ' << y;
}

TEST(EncodeIvfm, DrawsTheRobotOutsideTheWindowToo) {
  const DrawnMap map({"00"});
  const auto out = encode(map, {{0, 0}, 1}, {3500, 500}, 600);
  EXPECT_EQ(out[1], 20480);
  EXPECT_EQ(out[3], 49152);
}

TEST(EncodeIvfm, CutsTheGridAtTheWindowOnEverySide) {
  const DrawnMap map({"11",  //
                      "11"});
  const auto out = encode(map, {{-1, -1}, 1});
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 32; ++x) {
      const bool stored = (x == 1 || x == 2) && (y == 1 || y == 2);
      EXPECT_EQ(out[static_cast<std::size_t>(y * 32 + x)], stored ? 29944 : 20480);
    }
}

TEST(EncodeIvfm, RefusesWrongSizes) {
  const DrawnMap map({"00"});
  std::vector<std::uint16_t> out(kPolicyGridSize);
  VisitView view = map.view();
  EXPECT_EQ(encode_ivfm(view, {{0, 0}, 0}, {}, 0, out), Status::kInvalidArgument);
  EXPECT_EQ(encode_ivfm(view, {{0, 0}, 17}, {}, 0, out), Status::kInvalidArgument);
  EXPECT_EQ(encode_ivfm(view, {{0, 0}, 1}, {}, -1, out), Status::kInvalidArgument);
  EXPECT_EQ(encode_ivfm(view, {{0, 0}, 1}, {}, 0, std::span(out).first(1023)),
            Status::kInvalidArgument);
  view.peer_visits = view.peer_visits.first(1);
  EXPECT_EQ(encode_ivfm(view, {{0, 0}, 1}, {}, 0, out), Status::kInvalidArgument);
}

TEST(EncodeIvfm, AgreesWithThePlainDefinitionOnRandomMaps) {
  std::mt19937 random(1);
  DrawnMap map(std::vector<std::string>(50, std::string(60, '0')), 50'000);
  for (std::size_t i = 0; i < map.own.size(); ++i) {
    map.own[i] = static_cast<std::uint8_t>(random() % 4);
    map.peers[i] = static_cast<std::uint8_t>(random() % 3);
    map.flags[i] = static_cast<std::uint8_t>(random() % 8 == 0);
  }
  for (const int pool : {1, 2, 3, 8, 16}) {
    const Point robot{1'234'567, 987'654};
    const PolicyGrid grid = PolicyGrid::centred_on(map.frame.cell_at(robot), pool);
    const auto out = encode(map, grid, robot, 170'000);
    for (int i = 0; i < kPolicyGridSize; ++i) {
      const CellRect block = grid.block(i);
      unsigned sum = 0;
      for (int y = block.y; y < block.top(); ++y)
        for (int x = block.x; x < block.right(); ++x) {
          const Cell c{x, y};
          const bool stored = map.frame.contains(c);
          const std::size_t k = stored ? map.frame.index_of(c) : 0;
          const bool robots = squared_distance_um2(map.frame.center_of(c), robot) <=
                              std::int64_t{170'000} * 170'000;
          if (robots || (stored && map.flags[k] != 0))
            sum += 49152;
          else
            sum += kIvfmOfVisits[stored ? std::size_t{map.own[k]} + map.peers[k] : 0];
        }
      const unsigned area = static_cast<unsigned>(pool * pool);
      ASSERT_EQ(out[static_cast<std::size_t>(i)], (2 * sum + area) / (2 * area)) << pool;
    }
  }
}

TEST(EncodePath, TakesTheNearestCellOfABlock) {
  // Cost in 16ths of a map cell; pool 2, so a policy cell is 32 units = 256 steps.
  const std::vector<std::uint16_t> cost = {16, 32,    65535, 48,  //
                                           40, 65535, 65535, 24};
  std::vector<std::uint16_t> out(kPolicyGridSize);
  const PathView view{GridFrame(1000, {0, 0, 4, 2}), cost, 16, 65535};
  ASSERT_EQ(encode_path(view, {{0, 0}, 2}, out), Status::kOk);
  EXPECT_EQ(out[0], 128);
  EXPECT_EQ(out[1], 192);
  EXPECT_EQ(out[2], 65535);  // outside the window
  EXPECT_EQ(out[32], 65535);
}

TEST(EncodePath, SaturatesAt64PolicyCells) {
  const std::vector<std::uint16_t> cost = {63, 64, 65, 65534, 65535};
  std::vector<std::uint16_t> out(kPolicyGridSize);
  const PathView view{GridFrame(1000, {0, 0, 5, 1}), cost, 1, 65535};
  ASSERT_EQ(encode_path(view, {{0, 0}, 1}, out), Status::kOk);
  EXPECT_EQ(out[0], 63 * 256);
  EXPECT_EQ(out[1], 16384);
  EXPECT_EQ(out[2], 16384);
  EXPECT_EQ(out[3], 16384);
  EXPECT_EQ(out[4], 65535);
}

TEST(EncodePath, RoundsToNearest) {
  const std::vector<std::uint16_t> cost = {1, 2};
  std::vector<std::uint16_t> out(kPolicyGridSize);
  const PathView view{GridFrame(1000, {0, 0, 2, 1}), cost, 10, 65535};
  ASSERT_EQ(encode_path(view, {{0, 0}, 1}, out), Status::kOk);
  EXPECT_EQ(out[0], 26);  // 25.6
  EXPECT_EQ(out[1], 51);  // 51.2
}

TEST(EncodePath, RefusesWrongSizes) {
  const std::vector<std::uint16_t> cost = {1, 2};
  std::vector<std::uint16_t> out(kPolicyGridSize);
  PathView view{GridFrame(1000, {0, 0, 2, 1}), cost, 10, 65535};
  EXPECT_EQ(encode_path(view, {{0, 0}, 0}, out), Status::kInvalidArgument);
  view.units_per_cell = 0;
  EXPECT_EQ(encode_path(view, {{0, 0}, 1}, out), Status::kInvalidArgument);
  view.units_per_cell = 1;
  view.cost = view.cost.first(1);
  EXPECT_EQ(encode_path(view, {{0, 0}, 1}, out), Status::kInvalidArgument);
}

}  // namespace
}  // namespace ivfm

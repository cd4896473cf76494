#include "firmware/link/dirty_rectangles.h"

#include <gtest/gtest.h>

#include <random>
#include <set>
#include <utility>
#include <vector>

namespace ivfm {
namespace {

using Cells = std::set<std::pair<int, int>>;

void insert(Cells& cells, const CellRect& rect) {
  for (int y = rect.y; y < rect.top(); ++y) {
    for (int x = rect.x; x < rect.right(); ++x) cells.insert({x, y});
  }
}

std::vector<CellRect> drain(DirtyRectangles& dirty, std::int32_t area, std::int32_t side) {
  std::vector<CellRect> pieces;
  while (!dirty.empty()) {
    pieces.push_back(dirty.next_piece(area, side));
    dirty.take(pieces.back());
  }
  return pieces;
}

TEST(DirtyRectangles, GivesBackASmallRectangleWhole) {
  DirtyRectangles dirty;
  EXPECT_TRUE(dirty.empty());
  dirty.add({-3, 4, 10, 20});
  EXPECT_EQ(drain(dirty, 4096, 255), (std::vector<CellRect>{{-3, 4, 10, 20}}));
}

TEST(DirtyRectangles, AnEmptyRectangleIsNothing) {
  DirtyRectangles dirty;
  dirty.add({1, 1, 0, 5});
  EXPECT_TRUE(dirty.empty());
  EXPECT_TRUE(dirty.next_piece(100, 10).empty());
}

TEST(DirtyRectangles, TheSameAgainOrAPartOfItAddsNothing) {
  DirtyRectangles dirty;
  dirty.add({0, 0, 10, 10});
  dirty.add({0, 0, 10, 10});
  dirty.add({2, 2, 3, 3});
  EXPECT_EQ(drain(dirty, 4096, 255).size(), 1u);
}

TEST(DirtyRectangles, NeighboursThatFormARectangleBecomeOne) {
  DirtyRectangles dirty;
  dirty.add({0, 0, 10, 10});
  dirty.add({20, 0, 10, 10});
  dirty.add({10, 0, 10, 10});
  EXPECT_EQ(drain(dirty, 4096, 255), (std::vector<CellRect>{{0, 0, 30, 10}}));
}

TEST(DirtyRectangles, DistantOnesStayApart) {
  DirtyRectangles dirty;
  dirty.add({0, 0, 2, 2});
  dirty.add({100, 100, 2, 2});
  EXPECT_EQ(drain(dirty, 4096, 255), (std::vector<CellRect>{{0, 0, 2, 2}, {100, 100, 2, 2}}));
}

TEST(DirtyRectangles, AFullTableUnitesTheCheapestPair) {
  DirtyRectangles dirty;
  const auto capacity = static_cast<std::int32_t>(DirtyRectangles::kCapacity);
  for (std::int32_t i = 0; i < capacity; ++i) dirty.add({i * 1000, 0, 1, 1});
  dirty.add({5003, 0, 1, 1});
  const auto pieces = drain(dirty, 4096, 255);
  EXPECT_EQ(pieces.size(), DirtyRectangles::kCapacity);
  EXPECT_NE(std::find(pieces.begin(), pieces.end(), CellRect{5000, 0, 4, 1}), pieces.end());
}

TEST(DirtyRectangles, PiecesCoverAHugeRectangleOnceAndKeepTheLimits) {
  for (const CellRect rect : {CellRect{-700, -700, 1536, 1400}, CellRect{0, 0, 1000, 3},
                              CellRect{0, 0, 3, 1000}, CellRect{5, 5, 255, 255}}) {
    DirtyRectangles dirty;
    dirty.add(rect);
    Cells covered;
    std::int64_t area = 0;
    for (const CellRect& piece : drain(dirty, 4096, 255)) {
      ASSERT_GT(piece.area(), 0);
      ASSERT_LE(piece.area(), 4096);
      ASSERT_LE(piece.width, 255);
      ASSERT_LE(piece.height, 255);
      area += piece.area();
      insert(covered, piece);
    }
    EXPECT_EQ(area, rect.area());
    EXPECT_EQ(covered.size(), static_cast<std::size_t>(rect.area()));
  }
}

TEST(DirtyRectangles, NoCellIsEverLost) {
  std::mt19937 random(1);
  DirtyRectangles dirty;
  Cells expected;
  for (int round = 0; round < 400; ++round) {
    const CellRect rect{
        static_cast<std::int32_t>(random() % 400), static_cast<std::int32_t>(random() % 400),
        static_cast<std::int32_t>(1 + random() % 9), static_cast<std::int32_t>(1 + random() % 9)};
    dirty.add(rect);
    insert(expected, rect);
    ASSERT_TRUE(dirty.intersects(rect));
    if (round % 7 == 0) {
      const CellRect piece = dirty.next_piece(50, 50);
      dirty.take(piece);
      for (int y = piece.y; y < piece.top(); ++y) {
        for (int x = piece.x; x < piece.right(); ++x) {
          const CellRect cell{x, y, 1, 1};
          if (!dirty.intersects(cell)) expected.erase({x, y});
        }
      }
    }
  }
  Cells covered;
  for (const CellRect& piece : drain(dirty, 4096, 255)) insert(covered, piece);
  for (const auto& cell : expected) ASSERT_TRUE(covered.contains(cell));
}

TEST(DirtyRectangles, ClippingForgetsWhatIsOutsideAndCountsIt) {
  DirtyRectangles dirty;
  dirty.add({0, 0, 10, 10});
  dirty.add({100, 0, 5, 5});
  EXPECT_EQ(dirty.clip({0, 0, 8, 100}), 20 + 25);
  EXPECT_EQ(drain(dirty, 4096, 255), (std::vector<CellRect>{{0, 0, 8, 10}}));
}

}  // namespace
}  // namespace ivfm

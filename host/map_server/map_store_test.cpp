#include "host/map_server/map_store.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace ivfm::host {
namespace {

using Bytes = std::vector<std::uint8_t>;

class MapStoreTest : public testing::Test {
 protected:
  void visits(std::uint16_t robot, const CellRect& rect, const Bytes& cells) {
    changes_.clear();
    store_.merge(robot, 1, 1, Layer::kVisits, rect, cells, changes_);
  }
  void obstacle(std::uint16_t robot, std::uint32_t epoch, std::uint32_t sequence, Cell cell,
                std::uint8_t value) {
    changes_.clear();
    store_.merge(robot, epoch, sequence, Layer::kObstacles, {cell.x, cell.y, 1, 1}, Bytes{value},
                 changes_);
  }
  MapStore store_;
  std::vector<TileChange> changes_;
};

TEST_F(MapStoreTest, VisitsMergeByMaximumPerRobotAndSumOverRobots) {
  visits(1, {0, 0, 1, 1}, {5});
  visits(1, {0, 0, 1, 1}, {3});
  visits(2, {0, 0, 1, 1}, {4});
  EXPECT_EQ(store_.robot_value(1, Layer::kVisits, {0, 0}), 5);
  EXPECT_EQ(store_.merged_value(Layer::kVisits, {0, 0}), 9);
  EXPECT_EQ(store_.explored_cells(), 1u);
}

TEST_F(MapStoreTest, TheSumSaturatesAt255AndTheOthersShareIsStillRight) {
  visits(1, {0, 0, 1, 1}, {200});
  visits(2, {0, 0, 1, 1}, {100});
  EXPECT_EQ(store_.merged_value(Layer::kVisits, {0, 0}), 255);
  Bytes out(1);
  store_.read_without(std::array<std::uint16_t, 1>{1}, {Layer::kVisits, 0, 0}, {0, 0, 1, 1}, out);
  EXPECT_EQ(out[0], 100);
  store_.read_without(std::array<std::uint16_t, 1>{3}, {Layer::kVisits, 0, 0}, {0, 0, 1, 1}, out);
  EXPECT_EQ(out[0], 255);
}

TEST_F(MapStoreTest, ObstaclesMergeByTheNewestSequencePerRobotAndCell) {
  obstacle(1, 1, 5, {0, 0}, 1);
  obstacle(1, 1, 4, {0, 0}, 0);
  EXPECT_EQ(store_.robot_value(1, Layer::kObstacles, {0, 0}), 1);
  obstacle(1, 1, 4, {1, 0}, 1);  // another cell of the tile: 4 is the newest there
  EXPECT_EQ(store_.robot_value(1, Layer::kObstacles, {1, 0}), 1);
  obstacle(1, 1, 6, {0, 0}, 0);
  EXPECT_EQ(store_.robot_value(1, Layer::kObstacles, {0, 0}), 0);
  EXPECT_EQ(store_.obstacle_cells(), 1u);
}

TEST_F(MapStoreTest, ANewEpochIsNewerThanAnySequenceOfTheOld) {
  obstacle(1, 1, 1000, {0, 0}, 1);
  obstacle(1, 2, 1, {0, 0}, 0);
  obstacle(1, 1, 1001, {0, 0}, 1);
  EXPECT_EQ(store_.robot_value(1, Layer::kObstacles, {0, 0}), 0);
}

TEST_F(MapStoreTest, AnObstacleOfAnyRobotIsAnObstacle) {
  obstacle(1, 1, 1, {0, 0}, 1);
  obstacle(2, 1, 1, {0, 0}, 1);
  EXPECT_EQ(store_.merged_value(Layer::kObstacles, {0, 0}), 1);
  obstacle(1, 1, 2, {0, 0}, 0);
  EXPECT_EQ(store_.merged_value(Layer::kObstacles, {0, 0}), 1);
  obstacle(2, 1, 2, {0, 0}, 0);
  EXPECT_EQ(store_.merged_value(Layer::kObstacles, {0, 0}), 0);
}

TEST_F(MapStoreTest, NamesTheCellsOfEachTileThatChanged) {
  visits(1, {-2, 31, 4, 2}, Bytes(8, 1));
  ASSERT_EQ(changes_.size(), 4u);
  EXPECT_EQ(changes_[0].key, (TileKey{Layer::kVisits, -1, 0}));
  EXPECT_EQ(changes_[0].changed, (CellRect{-2, 31, 2, 1}));
  EXPECT_EQ(changes_[3].key, (TileKey{Layer::kVisits, 0, 1}));
  EXPECT_EQ(changes_[3].changed, (CellRect{0, 32, 2, 1}));
  visits(1, {-2, 31, 4, 2}, Bytes(8, 1));
  EXPECT_TRUE(changes_.empty());
}

TEST_F(MapStoreTest, AnObstacleSaidAgainIsToBeStoredButIsNoNews) {
  obstacle(1, 1, 1, {0, 0}, 1);
  obstacle(1, 1, 2, {0, 0}, 1);
  ASSERT_EQ(changes_.size(), 1u);
  EXPECT_TRUE(changes_[0].touched);
  EXPECT_TRUE(changes_[0].changed.empty());
}

TEST_F(MapStoreTest, AnyOrderAndRepetitionOfDatagramsGivesTheSameMap) {
  struct Sent {
    std::uint32_t sequence;
    Layer layer;
    CellRect rect;
    Bytes cells;
  };
  std::mt19937 random(1);
  std::vector<Sent> sent;
  std::array<Bytes, 2> truth = {Bytes(100 * 100), Bytes(100 * 100)};
  for (std::uint32_t sequence = 1; sequence <= 60; ++sequence) {
    const Layer layer = random() % 2 ? Layer::kVisits : Layer::kObstacles;
    const CellRect rect{
        static_cast<std::int32_t>(random() % 80), static_cast<std::int32_t>(random() % 80),
        static_cast<std::int32_t>(1 + random() % 20), static_cast<std::int32_t>(1 + random() % 20)};
    Bytes cells;
    for (std::int32_t y = rect.y; y < rect.top(); ++y) {
      for (std::int32_t x = rect.x; x < rect.right(); ++x) {
        std::uint8_t& value =
            truth[static_cast<std::size_t>(layer)][static_cast<std::size_t>(y * 100 + x)];
        if (layer == Layer::kVisits) {
          value = static_cast<std::uint8_t>(value + 1);
        } else {
          value = static_cast<std::uint8_t>(random() & 1u);
        }
        cells.push_back(value);
      }
    }
    sent.push_back({sequence, layer, rect, cells});
  }
  for (int round = 0; round < 5; ++round) {
    auto order = sent;
    order.insert(order.end(), sent.begin(), sent.begin() + 20);
    std::shuffle(order.begin(), order.end(), random);
    MapStore store;
    for (const Sent& one : order) {
      store.merge(1, 1, one.sequence, one.layer, one.rect, one.cells, changes_);
    }
    for (std::int32_t i = 0; i < 100 * 100; ++i) {
      for (const Layer layer : {Layer::kVisits, Layer::kObstacles}) {
        ASSERT_EQ(store.merged_value(layer, {i % 100, i / 100}),
                  truth[static_cast<std::size_t>(layer)][static_cast<std::size_t>(i)]);
      }
    }
  }
}

}  // namespace
}  // namespace ivfm::host

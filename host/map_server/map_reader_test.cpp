#include "host/map_server/map_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "host/map_server/run_database.h"
#include "host/map_server/scratch_folder.h"
#include "shared/wire/map_dump.h"

namespace ivfm::host {
namespace {

using testing::HasSubstr;

struct LayerMapSource final : MapRowSource {
  const LayerMap& map;
  explicit LayerMapSource(const LayerMap& m) : map(m) {}
  Status read_row(Layer layer, std::int32_t y, std::span<std::uint8_t> out) const override {
    for (std::size_t i = 0; i < out.size(); ++i) {
      out[i] = map.value(layer, {map.bounds.x + static_cast<std::int32_t>(i), y});
    }
    return Status::kOk;
  }
};

struct FileSink final : ByteSink {
  std::ofstream file;
  explicit FileSink(const std::filesystem::path& path) : file(path, std::ios::binary) {}
  Status write(std::span<const std::uint8_t> bytes) override {
    file.write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
    return Status::kOk;
  }
};

// Two robots: the first saw cells (0..9, 0) twice, the second cell (5, 0) 254 times; the first
// holds an obstacle at (-1, -1).
class MapReaderTest : public testing::Test {
 protected:
  MapReaderTest() {
    RunDatabase database(path_);
    MapStore store;
    std::vector<TileChange> changes;
    store.merge(1, 1, 1, Layer::kVisits, {0, 0, 10, 1}, std::vector<std::uint8_t>(10, 2), changes);
    store.merge(1, 1, 1, Layer::kObstacles, {-1, -1, 1, 1}, std::vector<std::uint8_t>{1}, changes);
    store.merge(2, 1, 1, Layer::kVisits, {5, 0, 1, 1}, std::vector<std::uint8_t>{254}, changes);
    database.begin();
    for (const std::uint16_t robot : {std::uint16_t{1}, std::uint16_t{2}}) {
      database.save_robot({robot, "r", 1, 0, 0, {}});
      for (const TileChange& change : changes) {
        const RobotTile* tile = store.robot_tile(robot, change.key);
        if (tile != nullptr) database.save_tile(robot, change.key, *tile);
      }
    }
    database.save_cell_um(50000);
    database.commit();
  }
  // What a robot holds in a window of 40 x 40 cells, with one cell changed if asked for.
  std::filesystem::path dump(std::uint16_t robot, bool spoil = false) {
    LayerMap map{50000,
                 {-20, -20, 40, 40},
                 std::vector<std::uint8_t>(1600),
                 std::vector<std::uint8_t>(1600)};
    const GridFrame frame(50000, map.bounds);
    if (robot == 1) {
      for (std::int32_t x = 0; x < 10; ++x) map.visits[frame.index_of({x, 0})] = 2;
      map.obstacles[frame.index_of({-1, -1})] = 1;
    } else {
      map.visits[frame.index_of({5, 0})] = 254;
    }
    if (spoil) map.visits[frame.index_of({7, 3})] = 1;
    const auto file = folder_ / ("robot" + std::to_string(robot) + ".dump");
    FileSink sink(file);
    EXPECT_EQ(write_map_dump({robot, 1, 50000, map.bounds}, LayerMapSource(map), sink),
              Status::kOk);
    return file;
  }
  ScratchFolder folder_;
  std::filesystem::path path_ = folder_ / "run.db";
};

TEST_F(MapReaderTest, LoadsOneRobotsMap) {
  const LayerMap map = load_robot_map(path_, 1);
  EXPECT_EQ(map.cell_um, 50000);
  EXPECT_EQ(map.bounds, (CellRect{-32, -32, 64, 64}));
  EXPECT_EQ(map.value(Layer::kVisits, {9, 0}), 2);
  EXPECT_EQ(map.value(Layer::kVisits, {10, 0}), 0);
  EXPECT_EQ(map.value(Layer::kObstacles, {-1, -1}), 1);
  EXPECT_EQ(map.value(Layer::kObstacles, {1000, 0}), 0);
  EXPECT_TRUE(load_robot_map(path_, 77).bounds.empty());
  EXPECT_EQ(load_robot_ids(path_), (std::vector<std::uint16_t>{1, 2}));
}

TEST_F(MapReaderTest, MergesByTheSaturatingSum) {
  const LayerMap map = load_merged_map(path_);
  EXPECT_EQ(map.value(Layer::kVisits, {4, 0}), 2);
  EXPECT_EQ(map.value(Layer::kVisits, {5, 0}), 255);
  EXPECT_EQ(map.value(Layer::kObstacles, {-1, -1}), 1);
}

TEST_F(MapReaderTest, EqualMapsCompareEqual) {
  const auto result = compare_with_dumps(path_, {dump(1), dump(2)});
  EXPECT_TRUE(result.equal()) << result.first_difference;
  EXPECT_EQ(result.cells_compared, 2u * 2 * 1600 + 2 * 64 * 64);
  EXPECT_EQ(result.explored_cells, 10u);
}

TEST_F(MapReaderTest, ADifferentCellIsNamed) {
  const auto result = compare_with_dumps(path_, {dump(1, true), dump(2)});
  EXPECT_FALSE(result.equal());
  EXPECT_EQ(result.cells_different, 2u);  // the robot's and the merged
  EXPECT_EQ(result.first_difference, "robot 1, cell (7, 3), visits: robots hold 1, the server 0");
}

TEST_F(MapReaderTest, MissingAndSurplusDumpsAreDifferences) {
  EXPECT_EQ(compare_with_dumps(path_, {dump(1)}).first_difference, "robot 2 has no dump");
  EXPECT_EQ(compare_with_dumps(path_, {dump(1), dump(1), dump(2)}).first_difference,
            "robot 1 has two dumps");
  EXPECT_EQ(compare_with_dumps(path_, {dump(1), dump(2), dump(3)}).first_difference,
            "robot 3 is not known to the server");
}

TEST_F(MapReaderTest, SaysWhatIsWrongWithAFile) {
  const auto message = [](auto call) -> std::string {
    try {
      call();
    } catch (const std::exception& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_THAT(message([&] { load_merged_map(folder_ / "none.db"); }), HasSubstr("does not exist"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "none.db"));
  std::ofstream(folder_ / "text") << "no database, and no dump either";
  EXPECT_THAT(message([&] { load_merged_map(folder_ / "text"); }), HasSubstr("another kind"));
  EXPECT_THAT(message([&] { load_map_dump(folder_ / "text"); }), HasSubstr("no proper dump"));
  EXPECT_THAT(message([&] { load_map_dump(folder_ / "none"); }), HasSubstr("cannot be read"));
}

}  // namespace
}  // namespace ivfm::host

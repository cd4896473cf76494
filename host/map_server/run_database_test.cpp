#include "host/map_server/run_database.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "host/map_server/scratch_folder.h"

namespace ivfm::host {
namespace {

using testing::HasSubstr;

std::string failure(const std::filesystem::path& path) {
  try {
    RunDatabase database(path);
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

class RunDatabaseTest : public testing::Test {
 protected:
  std::int64_t count(const char* sql) {
    SqliteConnection connection(path_, SqliteConnection::Mode::kRead);
    return connection.integer(sql).value_or(-1);
  }
  ScratchFolder folder_;
  std::filesystem::path path_ = folder_ / "run.db";
};

TEST_F(RunDatabaseTest, GivesBackRobotsAndTilesAfterReopening) {
  RobotTile visits, obstacles;
  visits.cells[5] = 7;
  obstacles.cells[1023] = 1;
  obstacles.epoch = 4000000000;
  obstacles.sequences = std::make_unique<std::array<std::uint32_t, kTileCells>>();
  obstacles.sequences->fill(0);
  (*obstacles.sequences)[1023] = 0x89abcdef;
  {
    RunDatabase database(path_);
    database.begin();
    database.save_robot({3, "r3", 17, 100, 200, {1, 2, 3, 4}});
    database.save_tile(3, {Layer::kVisits, -2, 5}, visits);
    database.save_tile(3, {Layer::kObstacles, 0, 0}, obstacles);
    database.save_cell_um(15625);
    database.save_time(777);
    database.commit();
  }
  RunDatabase database(path_);
  const auto robots = database.load_robots();
  ASSERT_EQ(robots.size(), 1u);
  EXPECT_EQ(robots[0].name, "r3");
  EXPECT_EQ(robots[0].epoch, 17u);
  EXPECT_EQ(robots[0].traffic, (TrafficCounters{1, 2, 3, 4}));
  EXPECT_EQ(database.cell_um(), 15625);
  EXPECT_EQ(database.last_time_us(), 777);
  MapStore store;
  database.load_tiles(store);
  EXPECT_EQ(store.robot_value(3, Layer::kVisits, {-64 + 5, 160}), 7);
  const RobotTile* tile = store.robot_tile(3, {Layer::kObstacles, 0, 0});
  ASSERT_NE(tile, nullptr);
  EXPECT_EQ(tile->epoch, 4000000000u);
  EXPECT_EQ((*tile->sequences)[1023], 0x89abcdefu);
}

TEST_F(RunDatabaseTest, EverySessionHasAGreaterEpoch) {
  RunDatabase database(path_);
  EXPECT_EQ(database.begin_session(5000000, 1.0), 5u);
  EXPECT_EQ(database.begin_session(5000000, 1.0), 6u);
  EXPECT_EQ(database.begin_session(1000000, 1.0), 7u);
  EXPECT_EQ(database.begin_session(2000000000000000, 1.0), 2000000000u);
}

TEST_F(RunDatabaseTest, KeepsTheTruthAtTheRunsTimes) {
  RunDatabase database(path_);
  EXPECT_LT(database.time_at(0), 0);
  database.begin_session(5'000'000, 4.0);
  EXPECT_EQ(database.time_at(5'500'000), 2'000'000);
  EXPECT_LT(database.time_at(4'000'000), 0);
  EXPECT_THROW(count("SELECT count(*) FROM truth"), DatabaseError);
  const TrueSample samples[] = {{10, 2, {{3, -4}, BinaryAngle(std::uint16_t{5})}}, {20, 2, {}}};
  database.save_truth(samples);
  database.save_truth(samples);
  EXPECT_EQ(count("SELECT count(*) FROM truth"), 2);
  EXPECT_EQ(count("SELECT y_um FROM truth WHERE time_us = 10"), -4);
}

TEST_F(RunDatabaseTest, WhatIsNotCommittedIsNotThere) {
  {
    RunDatabase database(path_);
    database.begin();
    database.save_robot({3, "r3", 17, 100, 200, {}});
  }
  RunDatabase database(path_);
  EXPECT_TRUE(database.load_robots().empty());
}

TEST_F(RunDatabaseTest, KeepsTheLogs) {
  RunDatabase database(path_);
  EXPECT_FALSE(database.finder().has_value());
  database.begin();
  database.add_pose(1, 2, {{3, -4}, BinaryAngle(std::uint16_t{5})});
  database.add_goal(1, 2, {3, -4});
  database.add_status(1, 2, {});
  database.add_event(1, std::nullopt, "note", "it's fine");
  database.add_event(2, 9, "found", "");
  database.add_traffic(1, 2, {});
  database.add_progress(1, 2, 3);
  database.commit();
  EXPECT_EQ(database.finder(), 9);
  EXPECT_EQ(count("SELECT y_um FROM poses"), -4);
  EXPECT_EQ(count("SELECT cell_y FROM goals"), -4);
  EXPECT_EQ(count("SELECT count(*) FROM events WHERE robot IS NULL"), 1);
  EXPECT_EQ(count("SELECT obstacle_cells FROM progress"), 3);
  EXPECT_EQ(count("PRAGMA application_id"), kRunDatabaseId);
}

TEST_F(RunDatabaseTest, ForgetsOldRowsButNeitherTheMapNorTheFind) {
  RunDatabase database(path_);
  database.begin();
  database.save_tile(2, {Layer::kVisits, 0, 0}, {});
  database.add_event(1, 9, "found", "");
  for (std::int64_t time = 1; time <= 10; ++time) {
    database.add_pose(time, 2, {});
    database.add_goal(time, 2, {});
    database.add_status(time, 2, {});
    database.add_event(time, 2, "started", "");
    database.add_traffic(time, 2, {});
    database.add_progress(time, 2, 3);
  }
  database.commit();
  const std::vector<std::string> tables{"poses", "goals", "status", "traffic", "progress"};
  for (const auto& [before, left] : {std::pair{1, 10}, {4, 7}, {4, 7}, {10, 1}, {11, 0}}) {
    database.begin();
    database.forget_before(before);
    database.commit();
    for (const std::string& table : tables) {
      EXPECT_EQ(count(("SELECT count(*) FROM " + table).c_str()), left) << table;
    }
    EXPECT_EQ(count("SELECT count(*) FROM events"), left + 1);
  }
  EXPECT_EQ(database.finder(), 9);
  EXPECT_EQ(count("SELECT count(*) FROM tiles"), 1);
  EXPECT_EQ(database.commit_times().count, 6u);
}

// The columns of a table as docs/run_database.md lists them, in order.
std::string documented_columns(const std::string& table) {
  std::ifstream file(IVFM_SOURCE_DIR "/docs/run_database.md");
  std::string line;
  while (std::getline(file, line)) {
    if (!line.starts_with("| `" + table + "` |")) continue;
    std::string columns;
    for (const char c : line.substr(line.rfind('|', line.size() - 2) + 1)) {
      if (c != '`' && c != ' ' && c != '|') columns += c;
    }
    return columns;
  }
  return "no row for this table";
}

TEST_F(RunDatabaseTest, TheDocumentListsEveryTableAndColumn) {
  { RunDatabase database(path_); }
  SqliteConnection connection(path_, SqliteConnection::Mode::kRead);
  SqliteStatement tables(connection,
                         "SELECT m.name, group_concat(c.name) FROM sqlite_master m, "
                         "pragma_table_info(m.name) c WHERE m.type = 'table' GROUP BY m.name");
  int count = 0;
  for (; tables.row(); ++count) {
    EXPECT_EQ(documented_columns(tables.text(0)), tables.text(1)) << tables.text(0);
  }
  EXPECT_EQ(count, 13);
}

TEST_F(RunDatabaseTest, ASecondServerIsKeptOut) {
  RunDatabase first(path_);
  EXPECT_THAT(failure(path_), HasSubstr("is in use by another map server"));
}

TEST_F(RunDatabaseTest, OtherFilesAreLeftAlone) {
  std::ofstream(folder_ / "notes.txt") << std::string(5000, 'x');
  EXPECT_THAT(failure(folder_ / "notes.txt"), HasSubstr("another kind of file"));
  EXPECT_EQ(std::filesystem::file_size(folder_ / "notes.txt"), 5000u);
  {
    SqliteConnection other(folder_ / "other.db", SqliteConnection::Mode::kWrite);
    other.execute("CREATE TABLE cats (name TEXT)");
  }
  EXPECT_THAT(failure(folder_ / "other.db"), HasSubstr("another program"));
}

TEST_F(RunDatabaseTest, ANewerSchemaIsNamed) {
  { RunDatabase database(path_); }
  {
    SqliteConnection connection(path_, SqliteConnection::Mode::kWrite);
    connection.execute("PRAGMA user_version = 3");
  }
  EXPECT_THAT(failure(path_), HasSubstr("schema version 3"));
}

TEST_F(RunDatabaseTest, AFolderThatIsNotThereIsNamed) {
  EXPECT_THAT(failure(folder_ / "none/run.db"), HasSubstr("No such file or directory"));
  EXPECT_THAT(failure(folder_.path()), HasSubstr("Is a directory"));
}

}  // namespace
}  // namespace ivfm::host

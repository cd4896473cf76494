#include "host/log_analysis/run_export.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "host/log_analysis/synthetic_run.h"
#include "host/map_server/scratch_folder.h"
#include "host/simulator/map_file.h"

namespace ivfm::host {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

std::string contents(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

class RunExportTest : public testing::Test {
 protected:
  RunExportTest() { write_synthetic_run(database_, {}); }
  ScratchFolder folder_;
  const std::filesystem::path database_ = folder_ / "run.db";
};

TEST_F(RunExportTest, RosMapReadsBackAsTheSameCells) {
  export_ros_map(database_, folder_ / "map.yaml");
  const World world = load_map_file(folder_ / "map.yaml");
  const RunData run = load_run(database_);
  EXPECT_EQ(world.cell_um, run.map.cell_um);
  EXPECT_EQ(world.width, run.map.bounds.width);
  EXPECT_EQ(world.origin.x_um, run.map.bounds.x * run.map.cell_um);
  std::uint64_t free = 0;
  for (const std::uint8_t occupied : world.occupied) free += occupied == 0 ? 1u : 0u;
  EXPECT_EQ(free, run.explored_cells);
}

TEST_F(RunExportTest, CsvHasAFileATableAndARowARow) {
  {
    RunDatabase database(database_);
    database.add_event(5, 1, "refused", "cells of \"2\", um");
  }
  export_csv(database_, folder_ / "csv");
  EXPECT_THAT(contents(folder_ / "csv" / "poses.csv"),
              StartsWith("time_us,robot,x_um,y_um,heading\r\n100000,1,"));
  EXPECT_THAT(contents(folder_ / "csv" / "events.csv"),
              HasSubstr("\"cells of \"\"2\"\", um\"\r\n"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "csv" / "status.csv"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "csv" / "tiles.csv"));
}

TEST_F(RunExportTest, SvgShowsEveryRobotsPath) {
  export_svg(database_, folder_ / "run.svg");
  const std::string svg = contents(folder_ / "run.svg");
  EXPECT_THAT(svg, StartsWith("<svg xmlns=\"http://www.w3.org/2000/svg\""));
  EXPECT_THAT(svg, HasSubstr("<g id=\"robot2\">"));
  EXPECT_THAT(svg, HasSubstr("id=\"visited\""));
}

TEST_F(RunExportTest, SaysWhatCannotBeWritten) {
  EXPECT_THROW(export_svg(database_, folder_ / "none" / "run.svg"), std::runtime_error);
  EXPECT_THROW(export_csv(database_, database_), std::runtime_error);
  RunDatabase(folder_ / "empty.db");
  EXPECT_THROW(export_svg(folder_ / "empty.db", folder_ / "x.svg"), std::runtime_error);
}

}  // namespace
}  // namespace ivfm::host

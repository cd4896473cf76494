#include "host/simulator/truth_log.h"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <cmath>

#include "firmware/hal/fake/fake_can_bus.h"

namespace ivfm::host {
namespace {

class TruthLogTest : public testing::Test {
 protected:
  TruthLogTest() {
    std::string pattern = (std::filesystem::temp_directory_path() / "ivfm_truth_XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
  }
  ~TruthLogTest() override { std::filesystem::remove_all(folder_); }
  std::filesystem::path folder_;
};

TEST_F(TruthLogTest, WritesEachRobotTenTimesASecond) {
  PreparedWorld world;
  world.world = {"w", 50'000, 80, 80, {-2'000'000, -2'000'000}, std::vector<std::uint8_t>(6400, 0)};
  world.starts = {Pose{}, {{1'000'000, -500'000}, BinaryAngle(std::uint16_t{0x4000})}};
  fake::FakeCanWire<1> first, second;
  Simulation simulation(world, {}, {folder_ / "1", folder_ / "2"}, {&first.end(0), &second.end(0)});
  {
    TruthLog log(folder_ / "truth.csv");
    for (TimeUs now = 5'000; now <= 1'000'000; now += 5'000) {
      simulation.advance_to(now);
      log.record(simulation, 1'700'000'000'000'000 + static_cast<std::int64_t>(now));
    }
  }
  const auto rows = read_truth_log(folder_ / "truth.csv");
  ASSERT_EQ(rows.size(), 20u);
  EXPECT_EQ(rows[1].robot, 2);
  EXPECT_DOUBLE_EQ(rows[1].pose.x_m, 1);
  EXPECT_DOUBLE_EQ(rows[1].pose.y_m, -0.5);
  EXPECT_NEAR(rows[1].pose.heading_rad, M_PI / 2, 1e-4);
  EXPECT_NEAR(rows[2].time_s - rows[0].time_s, 0.1, 1e-9);
  EXPECT_EQ(rows[2].unix_us - rows[0].unix_us, 100'000);
}

TEST_F(TruthLogTest, LeavesOutDamagedRowsAndRefusesOtherFiles) {
  std::ofstream(folder_ / "cut.csv")
      << "time_s,robot,x_m,y_m,heading_deg,travelled_m,collisions,unix_us\n"
         "0.1,1,2,3,90,0.5,0,7\n0.2,x\n\n0.3,2,1,1,0,0,1,9\n0.4,1,5,5,0,0,0,1";
  const auto rows = read_truth_log(folder_ / "cut.csv");
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[1].collisions, 1);
  std::ofstream(folder_ / "other.csv") << "a,b\n";
  EXPECT_THROW(read_truth_log(folder_ / "other.csv"), std::runtime_error);
  EXPECT_THROW(read_truth_log(folder_ / "none.csv"), std::runtime_error);
  EXPECT_THROW(TruthLog("/nowhere/truth.csv"), std::runtime_error);
}

}  // namespace
}  // namespace ivfm::host

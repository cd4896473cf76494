#include "host/log_analysis/pose_errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "host/log_analysis/run_compare.h"
#include "host/log_analysis/run_report.h"
#include "host/map_server/map_reader.h"
#include "host/map_server/run_database.h"
#include "host/map_server/scratch_folder.h"

namespace ivfm::host {
namespace {

constexpr double kTurnRadPerS = 0.5;

Pose on_circle(double time_s, double off_m) {
  const double angle = time_s * kTurnRadPerS;
  const auto um = [](double metres) {
    return static_cast<std::int32_t>(std::lround(metres * 1e6));
  };
  return {{um(std::cos(angle) + off_m), um(std::sin(angle))}, BinaryAngle::from_radians(angle)};
}

// Robot 1 drives a circle of 1 m for 20 s. It tells its pose four times a second, 120 ms late:
// exact for 10 s, then 0.3 m off.
std::filesystem::path circle(const ScratchFolder& folder, bool truth_is_known) {
  const auto path = folder / "run.db";
  RunDatabase database(path);
  database.begin_session(0, 1);
  database.begin();
  database.save_time(20'000'000);
  database.save_robot({1, "one", 1, 0, 20'000'000, {}});
  for (int i = 0; i < 80; ++i) {
    const double time_s = i * 0.25;
    database.add_pose(static_cast<std::int64_t>((time_s + 0.12) * 1e6), 1,
                      on_circle(time_s, time_s < 10 ? 0 : 0.3));
  }
  std::vector<TrueSample> truth;
  for (int i = 0; i <= 200; ++i) truth.push_back({i * 100'000, 1, on_circle(i * 0.1, 0)});
  truth.push_back({0, 2, {}});  // a robot that never told where it was
  if (truth_is_known) database.save_truth(truth);
  database.commit();
  return path;
}

TEST(PoseErrors, ComparesWithTheTruthOfTheSameMoment) {
  const ScratchFolder folder;
  SqliteConnection connection = open_run_database(circle(folder, true));
  const auto robots = load_pose_errors(connection, 1000);
  ASSERT_EQ(robots.size(), 1u);
  const PoseErrors& errors = robots.at(1);
  EXPECT_EQ(errors.poses, 80u);
  EXPECT_NEAR(errors.delay_s, 0.12, 1e-9);
  EXPECT_NEAR(errors.largest_m, 0.3, 0.002);
  EXPECT_NEAR(errors.rms_m, 0.3 / std::sqrt(2), 0.002);
  EXPECT_LT(errors.largest_deg, 0.05);
  EXPECT_LT(errors.position_m.front().second, 0.001);
  const PoseErrors all = over_all(robots);
  EXPECT_DOUBLE_EQ(all.rms_m, errors.rms_m);
  EXPECT_DOUBLE_EQ(all.largest_m, errors.largest_m);
}

TEST(PoseErrors, ThinCurvesKeepThePeaks) {
  const ScratchFolder folder;
  SqliteConnection connection = open_run_database(circle(folder, true));
  const auto curve = load_pose_errors(connection, 8).at(1).position_m;
  ASSERT_EQ(curve.size(), 8u);
  EXPECT_NEAR(curve.back().second, 0.3, 0.002);
  EXPECT_LT(curve.front().second, 0.001);
}

TEST(PoseErrors, AreInTheReportAndTheFigures) {
  const ScratchFolder folder;
  const RunData run = load_run(circle(folder, true));
  const auto json = nlohmann::json::parse(metrics_json(run));
  EXPECT_NEAR(json["position_error_largest_m"], 0.3, 0.002);
  EXPECT_NEAR(json["robots"][0]["position_error_rms_m"], 0.3 / std::sqrt(2), 0.002);
  EXPECT_THAT(render_run_report(run, {}, {}), testing::HasSubstr("Where they were"));
}

TEST(PoseErrors, WithoutTruthThereAreNone) {
  const ScratchFolder folder;
  const RunData run = load_run(circle(folder, false));
  EXPECT_TRUE(run.pose_errors.empty());
  EXPECT_TRUE(run.warnings.empty());
  EXPECT_EQ(nlohmann::json::parse(metrics_json(run))["position_error_rms_m"], nullptr);
  EXPECT_THAT(render_run_report(run, {}, {}), testing::Not(testing::HasSubstr("Where they were")));
}

}  // namespace
}  // namespace ivfm::host

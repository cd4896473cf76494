#include "host/log_analysis/log_command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "host/log_analysis/run_compare.h"
#include "host/log_analysis/run_export.h"
#include "host/log_analysis/run_video.h"
#include "host/log_analysis/synthetic_run.h"
#include "host/map_server/scratch_folder.h"

namespace ivfm::host {
namespace {

using testing::HasSubstr;
using testing::Not;

// Two robots saw 4 and 2 cells of 0.5 m, one of them both, once each; robot 1 restarted.
std::filesystem::path small_run(const ScratchFolder& folder) {
  const auto path = folder / "run.db";
  RunDatabase database(path);
  database.begin_session(0, 1);
  database.begin();
  database.save_cell_um(500000);
  database.save_time(9000000);
  database.save_robot({1, "one", 1, 0, 9000000, {10, 1000, 5, 500, {{{200, 40}, {100, 20}}}}});
  database.save_robot({2, "", 1, 0, 9000000, {1, 100, 1, 50}});
  RobotTile first, second;
  for (const std::size_t i : {0, 1, 2, 3}) first.cells[i] = 1;
  for (const std::size_t i : {3, 4}) second.cells[i] = 1;
  database.save_tile(1, {Layer::kVisits, 0, 0}, first);
  database.save_tile(2, {Layer::kVisits, 0, 0}, second);
  RobotStatus status;
  status.state = 2;  // exploring
  status.distance_mm = 3000;
  status.actions = 4;
  status.decision_us = 2500;
  database.add_status(1000000, 1, status);
  status.distance_mm = 500;  // started again
  status.actions = 1;
  status.decision_us = 1500;
  database.add_status(4000000, 1, status);
  status.state = 6;
  status.fault = 1;
  database.add_status(5000000, 1, status);
  database.add_event(500000, 1, "started", "epoch 1");
  database.add_pose(1000000, 1, {{0, 0}, {}});
  database.add_pose(2000000, 1, {{1000000, 0}, {}});
  database.add_progress(2000000, 2, 0);
  database.add_progress(8000000, 5, 0);
  database.commit();
  return path;
}

std::string failure(const std::filesystem::path& database) {
  try {
    load_run(database);
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

TEST(LogCommand, ReportsTheFiguresOfARun) {
  const ScratchFolder folder;
  const auto json = nlohmann::json::parse(metrics_json(load_run(small_run(folder))));
  EXPECT_EQ(json["time_s"], 9.0);
  EXPECT_EQ(json["explored_cells"], 5);
  EXPECT_DOUBLE_EQ(json["explored_m2"], 1.25);  // 5 x 0.25 m2
  EXPECT_DOUBLE_EQ(json["rer"], 0.2);           // 6 visits of 5 cells
  EXPECT_DOUBLE_EQ(json["overlap"], 0.2);       // 1 cell of 5
  EXPECT_DOUBLE_EQ(json["driven_m"], 3.5);      // 3 m, and 0.5 m after the restart
  EXPECT_DOUBLE_EQ(json["pe"], 1.25 * 128 * 128 / 3.5);
  EXPECT_EQ(json["steps"], 5);
  EXPECT_EQ(json["wire_bytes"], 1650);
  EXPECT_DOUBLE_EQ(json["bandwidth_paper_mib"], (5 * (65536 + 12) + 60) / 1048576.0);
  EXPECT_EQ(json["coverage"], nullptr);  // nobody who knows the world has judged
  EXPECT_EQ(json["robots"][0]["name"], "one");
  EXPECT_EQ(json["robots"][0]["state"], "fault");
  EXPECT_EQ(json["robots"][0]["actions"], 5);
  EXPECT_EQ(json["robots"][0]["slowest_decision_ms"], 2.5);
  EXPECT_EQ(json["robots"][0]["bytes_in"], 1000);
  EXPECT_EQ(json["robots"][0]["obstacle_bytes"], 100);
  EXPECT_EQ(json["robots"][1]["name"], "robot 2");
  EXPECT_TRUE(json["warnings"].empty());
}

TEST(LogCommand, TakesTheWordOfARunsJudge) {
  const ScratchFolder folder;
  const auto path = small_run(folder);
  {
    RunDatabase database(path);
    database.save_outcome("coverage", 0.5);
    database.save_outcome("driven_m", 4);  // the truth; odometry says 3.5
  }
  const auto json = nlohmann::json::parse(metrics_json(load_run(path)));
  EXPECT_EQ(json["coverage"], 0.5);
  EXPECT_EQ(json["driven_m"], 4.0);
  EXPECT_DOUBLE_EQ(json["pe"], 1.25 * 128 * 128 / 4);
  EXPECT_EQ(json["reported"]["coverage"], 0.5);
}

TEST(LogCommand, ComparesTwoRuns) {
  const ScratchFolder folder;
  const RunData a = load_run(small_run(folder));
  RunData b = a;
  b.name = "other.db";
  b.time_s = 18;
  const std::string text = compare_as_text(a, b);
  EXPECT_THAT(text, HasSubstr("other.db"));
  EXPECT_THAT(text, HasSubstr("+100.0 %"));
  EXPECT_EQ(nlohmann::json::parse(compare_as_json(a, b))["b"]["time_s"], 18);
  EXPECT_THAT(compare_as_html(a, b), HasSubstr("Explored over time"));
}

TEST(LogCommand, FilmsARun) {
  const ScratchFolder folder;
  write_synthetic_run(folder / "run.db", {});
  VideoOptions options;
  options.length_s = 1;
  options.width_px = 320;
  std::uint64_t frames = 0;
  write_run_video(folder / "run.db", folder / "run.mp4", options,
                  [&frames](std::uint64_t done) { frames = done; });
  EXPECT_EQ(frames, 25u);
  std::ifstream in(folder / "run.mp4", std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  EXPECT_EQ(bytes.substr(4, 4), "ftyp");  // ISO/IEC 14496-12
  EXPECT_THROW(write_run_video(folder / "run.db", folder / "none" / "x.mp4", options),
               std::runtime_error);
}

TEST(LogCommand, TellsWhatHappenedInOrder) {
  const ScratchFolder folder;
  std::ostringstream out;
  print_timeline(small_run(folder), out);
  EXPECT_EQ(out.str(),
            "       0.5 s  robot 1  started: epoch 1\n"
            "       1.0 s  robot 1  exploring\n"
            "       5.0 s  robot 1  fault (lidar silent)\n");
}

TEST(LogCommand, AnswersQueriesAsATableAndChangesNothing) {
  const ScratchFolder folder;
  const auto path = small_run(folder);
  std::ostringstream out;
  print_query(path, "SELECT robot, name, NULL AS none FROM robots", out);
  EXPECT_EQ(out.str(), "robot  name  none\n1      one   \n2            \n");
  std::ostringstream blobs;
  print_query(path, "SELECT cells FROM tiles LIMIT 1", blobs);
  EXPECT_EQ(blobs.str(), "cells\n(1024 bytes)\n");
  EXPECT_THROW(print_query(path, "SELECT nothing FROM nowhere", out), std::runtime_error);
  EXPECT_THROW(print_query(path, "", out), std::runtime_error);
  EXPECT_THROW(print_query(path, "DELETE FROM robots", out), std::runtime_error);
  EXPECT_EQ(load_robot_ids(path).size(), 2u);
}

TEST(LogCommand, WritesOnePageAndAPicture) {
  const ScratchFolder folder;
  const auto path = small_run(folder);
  write_log_report(path, folder / "report.html");
  std::ifstream in(folder / "report.html");
  const std::string html{std::istreambuf_iterator<char>(in), {}};
  EXPECT_THAT(html, HasSubstr("data:image/png;base64,"));
  EXPECT_THAT(html, HasSubstr("1.2 m²"));
  EXPECT_THAT(html, HasSubstr("bandwidth, paper"));
  EXPECT_THAT(html, HasSubstr("lidar silent"));
  EXPECT_THAT(html, Not(HasSubstr("http")));
  write_log_map(path, folder / "map.png");
  EXPECT_GT(std::filesystem::file_size(folder / "map.png"), 1000u);
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder / ".")) {
    files += entry.path().extension() == ".png" ? 1 : 0;
  }
  EXPECT_EQ(files, 1);
  EXPECT_THROW(write_log_report(path, folder / "none" / "report.html"), std::runtime_error);
}

TEST(LogCommand, SaysInOneSentenceWhatIsWrongWithAFile) {
  const ScratchFolder folder;
  EXPECT_THAT(failure(folder / "none.db"), HasSubstr("does not exist"));
  std::ofstream(folder / "text.db") << std::string(5000, 'x');
  EXPECT_THAT(failure(folder / "text.db"), HasSubstr("is not a run database"));
  std::ofstream(folder / "empty.db");
  EXPECT_THAT(failure(folder / "empty.db"), HasSubstr("is empty"));
  const auto path = small_run(folder);
  std::filesystem::copy_file(path, folder / "cut.db");
  std::filesystem::resize_file(folder / "cut.db", 1000);
  EXPECT_THAT(failure(folder / "cut.db"), HasSubstr("run database '"));
}

TEST(LogCommand, SaysThatAnotherProgramKeepsAFileLocked) {
  const ScratchFolder folder;
  const auto path = small_run(folder);
  SqliteConnection other(path, SqliteConnection::Mode::kWrite);
  other.execute("PRAGMA locking_mode = EXCLUSIVE; BEGIN EXCLUSIVE;");
  EXPECT_THAT(failure(path), HasSubstr("keeps it locked"));
}

TEST(LogCommand, SavesWhatCanBeReadOfADamagedFile) {
  const ScratchFolder folder;
  write_synthetic_run(folder / "run.db", {});
  const auto whole = std::filesystem::file_size(folder / "run.db");
  const RunData intact = load_run(folder / "run.db");
  ASSERT_TRUE(intact.warnings.empty());
  int partly = 0;
  for (const double share : {0.2, 0.5, 0.9}) {
    const auto cut = folder / "cut.db";
    std::filesystem::copy_file(folder / "run.db", cut,
                               std::filesystem::copy_options::overwrite_existing);
    std::filesystem::resize_file(cut,
                                 static_cast<std::uintmax_t>(share * static_cast<double>(whole)));
    const RunData run = load_run(cut);
    ASSERT_FALSE(run.warnings.empty()) << share;
    EXPECT_THAT(run.warnings[0], HasSubstr("cut off"));
    partly += run.explored_cells > 0 || run.driven_m > 0 ? 1 : 0;
    write_log_report(cut, folder / "cut.html");
  }
  EXPECT_GE(partly, 2);
}

TEST(LogCommand, EveryCommandSavesWhatItCanAndSaysWhatItCannot) {
  const ScratchFolder folder;
  const auto cut = folder / "cut.db";
  int warned = 0;
  std::ptrdiff_t most_rows = 0;
  for (const double share : {0.2, 0.4, 0.6}) {
    std::filesystem::remove(cut);
    write_synthetic_run(cut, {});
    const auto whole = static_cast<double>(std::filesystem::file_size(cut));
    std::filesystem::resize_file(cut, static_cast<std::uintmax_t>(share * whole));
    Warnings warnings;
    EXPECT_FALSE(load_timeline(cut, warnings).empty()) << share;
    std::ostringstream out;
    print_query(cut, "SELECT * FROM poses", out);
    const std::string rows = out.str();
    most_rows = std::max(most_rows, std::count(rows.begin(), rows.end(), '\n'));
    warned += export_csv(cut, folder / "csv").empty() ? 0 : 1;
  }
  EXPECT_GE(warned, 1);
  EXPECT_GT(most_rows, 100);
}

TEST(LogCommand, SaysThatAFolderIsNone) {
  const ScratchFolder folder;
  EXPECT_THAT(failure(folder / "."), HasSubstr("is a folder"));
}

}  // namespace
}  // namespace ivfm::host

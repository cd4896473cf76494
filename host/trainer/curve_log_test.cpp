#include "host/trainer/curve_log.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>

namespace ivfm::host {
namespace {

class CurveLogTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::path(testing::TempDir()) /
              testing::UnitTest::GetInstance()->current_test_info()->name();
    std::filesystem::remove_all(folder_);
  }
  std::string file(const std::string& name) const { return (folder_ / name).string(); }
  static std::string content(const std::string& path) {
    std::ifstream in(path);
    return {std::istreambuf_iterator<char>(in), {}};
  }

  std::filesystem::path folder_;
};

TEST_F(CurveLogTest, WritesOneRowAReportAndLeavesMissingValuesEmpty) {
  CurveLog log(file("c.csv"), {"loss", "steps"}, 0);
  log.add(10, {0.5, std::nan("")});
  log.add(20, {0.25, 31});
  EXPECT_EQ(content(file("c.csv")), "step,loss,steps\n10,0.5,\n20,0.25,31\n");
}

TEST_F(CurveLogTest, DropsRowsAfterTheCheckpointWhenResumed) {
  {
    CurveLog log(file("c.csv"), {"loss"}, 0);
    log.add(10, {3});
    log.add(20, {2});
    log.add(30, {1});
  }
  CurveLog log(file("c.csv"), {"loss"}, 20);
  log.add(30, {7});
  EXPECT_EQ(content(file("c.csv")), "step,loss\n10,3\n20,2\n30,7\n");
}

TEST_F(CurveLogTest, RefusesToContinueAFileWithOtherColumns) {
  { CurveLog(file("c.csv"), {"loss"}, 0).add(10, {3}); }
  EXPECT_THROW(CurveLog(file("c.csv"), {"q"}, 10), std::runtime_error);
}

TEST_F(CurveLogTest, DrawsAPanelForEveryColumn) {
  CurveLog log(file("c.csv"), {"loss", "steps"}, 0);
  log.add(10, {1, 2});
  log.add(20, {0, 2});
  log.plot(file("c.svg"));
  const std::string svg = content(file("c.svg"));
  EXPECT_NE(svg.find(">loss<"), std::string::npos);
  EXPECT_NE(svg.find(">steps<"), std::string::npos);
  EXPECT_NE(svg.find("</svg>"), std::string::npos);
}

TEST_F(CurveLogTest, NamesTheFileThatCannotBeWritten) {
  std::filesystem::create_directories(folder_);
  { std::ofstream(file("blocker")) << "a file, not a folder"; }
  try {
    CurveLog(file("blocker/c.csv"), {"loss"}, 0);
    FAIL() << "no error";
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find("blocker/c.csv"), std::string::npos);
  }
}

}  // namespace
}  // namespace ivfm::host

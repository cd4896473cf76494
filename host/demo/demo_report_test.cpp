#include "host/demo/demo_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>

#include <fstream>

namespace ivfm::host {
namespace {

using testing::HasSubstr;
using testing::Not;

DemoReport small_report() {
  DemoReport report;
  report.title = "Two <robots>";
  report.verdicts = {{true, "goal reached"}, {false, "1 collision"}};
  report.figures = {{"51 %", "explored", ""}};
  report.goal = 0.5;
  report.progress = {{0, 0, 0}, {10, 0.2, 3}, {40, 0.51, 12}};
  report.table_head = {"robot", "driven"};
  report.table = {{"robot 1", "6.1 m"}};
  report.command = "ivfm demo --seed 1";
  return report;
}

TEST(DemoReport, IsOnePageThatNeedsNothingElse) {
  std::string pattern = (std::filesystem::temp_directory_path() / "ivfm_report_XXXXXX").string();
  const std::filesystem::path folder = mkdtemp(pattern.data());
  DemoReport report = small_report();
  report.map_picture = folder / "map.png";
  std::ofstream(report.map_picture) << "foobar";
  const std::string html = render_report(report);
  EXPECT_THAT(html, HasSubstr("data:image/png;base64,Zm9vYmFy\""));  // RFC 4648, section 10
  EXPECT_THAT(html, Not(HasSubstr("http")));
  EXPECT_THAT(html, Not(HasSubstr("src=\"map")));
  EXPECT_THAT(html, HasSubstr("goal reached"));
  EXPECT_THAT(html, HasSubstr("Two &lt;robots&gt;"));
  std::ofstream(report.map_picture) << "fooba";
  EXPECT_THAT(render_report(report), HasSubstr("base64,Zm9vYmE=\""));
  std::filesystem::remove_all(folder);
  EXPECT_THROW(render_report(report), std::runtime_error);
}

TEST(DemoReport, TheCurveEndsAtTheLastMomentAndShowsTheGoal) {
  const std::string svg = render_coverage_curve(small_report().progress, 0.5);
  EXPECT_THAT(svg, HasSubstr("52.0,244.0"));    // nothing at the start
  EXPECT_THAT(svg, HasSubstr("1112.0,126.7"));  // 51 % at the right end
  EXPECT_THAT(svg, HasSubstr("goal 50 %"));
  EXPECT_THAT(render_coverage_curve({}, 0), HasSubstr("</svg>"));
}

}  // namespace
}  // namespace ivfm::host

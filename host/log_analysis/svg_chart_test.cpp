#include "host/log_analysis/svg_chart.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ivfm::host {
namespace {

using testing::HasSubstr;
using testing::Not;

const std::vector<BarKind> kKinds{{"good", "#111"}, {"<bad>", "#222"}};

TEST(SvgChart, LinesEndAtTheirLastPointAndTheMarkIsThere) {
  ChartAxes axes{"Area", "s", "m²", 0, 0, 5, "goal", 1130};
  const std::string svg = render_chart(axes, {{"", "#1b7f5c", {{0, 0}, {40, 10}}}});
  EXPECT_THAT(svg, HasSubstr("points=\"64.0,212.0 1118.0,12.0 \""));
  EXPECT_THAT(svg, HasSubstr(">goal</text>"));
  EXPECT_THAT(svg, HasSubstr("aria-label=\"Area\""));
  EXPECT_THAT(render_chart(axes, {}), HasSubstr("</svg>"));
  // 0 lies in the middle between 1 and -1.
  EXPECT_THAT(
      render_chart({"v", "s", "m/s", 0, 0, 0, "", 1130}, {{"", "#111", {{0, -1}, {1, 1}, {2, 0}}}}),
      HasSubstr("points=\"64.0,212.0 591.0,12.0 1118.0,112.0 \""));
}

TEST(SvgChart, BarsStackAndSayWhatTheyAre) {
  const std::string svg =
      render_bars({"t", "", "m", 0, 0, 0, "", 1130}, kKinds, {{"1", {1, 3}}, {"2", {2, 0}}});
  EXPECT_THAT(svg, HasSubstr("<title>1, &lt;bad&gt;: 3 m</title>"));
  EXPECT_THAT(svg, HasSubstr("height=\"150.0\" fill=\"#222\""));  // 3 of 4, of 200
  EXPECT_THAT(svg, Not(HasSubstr("<bad>")));
}

TEST(SvgChart, LanesLeaveOutWhatIsTooNarrowToSee) {
  Lane lane{"robot 1", {{0, 50, 0, "long"}, {50, 50.001, 1, "short"}, {60, 100, 1, "late"}}};
  const std::string svg = render_lanes({"t", "s", "", 100, 0, 0, "", 1130}, kKinds, {lane});
  EXPECT_THAT(svg, HasSubstr("long"));
  EXPECT_THAT(svg, HasSubstr("late"));
  EXPECT_THAT(svg, Not(HasSubstr("short")));
}

}  // namespace
}  // namespace ivfm::host

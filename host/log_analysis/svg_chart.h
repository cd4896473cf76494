// Charts as SVG text for the reports: lines, stacked bars, and lanes over time.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace ivfm::host {

// `&`, `<`, `>` and `"` as HTML wants them.
std::string html_escaped(const std::string& text);

struct ChartSeries {
  std::string label;                              // for the legend; may be empty
  std::string colour;                             // of CSS
  std::vector<std::pair<double, double>> points;  // x rises
  bool dots = false;                              // points instead of a line
  bool filled = false;                            // the area below the line
};

struct ChartAxes {
  std::string title;  // for those who do not see the picture
  std::string x_unit, y_unit;
  double x_end = 0;     // 0: where the points end
  double y_top = 0;     // 0: as high as the points
  double mark_y = 0;    // a dashed line there; 0: none
  std::string mark;     // what it means
  double width = 1130;  // of the drawing, in its own units
};

std::string render_chart(const ChartAxes& axes, const std::vector<ChartSeries>& series);

// A bar of stacked parts; parts[i] has the colour and meaning of BarKinds[i].
struct Bar {
  std::string label;
  std::vector<double> parts;
};
struct BarKind {
  std::string label, colour;
};
// Upright bars.
std::string render_bars(const ChartAxes& axes, const std::vector<BarKind>& kinds,
                        const std::vector<Bar>& bars);
// Lying bars, one below the other, with their labels on the left.
std::string render_lying_bars(const ChartAxes& axes, const std::vector<BarKind>& kinds,
                              const std::vector<Bar>& bars);

// Stretches of time of one thing; `kind` is an index of the kinds.
struct LaneSpan {
  double begin = 0, end = 0;
  std::size_t kind = 0;
  std::string text;  // shown when pointed at
};
struct Lane {
  std::string label;
  std::vector<LaneSpan> spans;
};
std::string render_lanes(const ChartAxes& axes, const std::vector<BarKind>& kinds,
                         const std::vector<Lane>& lanes);

// A row of colours and what they mean.
std::string render_legend(const std::vector<BarKind>& kinds);

}  // namespace ivfm::host

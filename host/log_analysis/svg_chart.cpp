#include "host/log_analysis/svg_chart.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace ivfm::host {
namespace {

constexpr double kLeft = 64, kRight = 12, kTop = 12, kHeight = 200, kBottom = 30;
constexpr double kLabels = 150;  // width of the labels of lanes and lying bars
constexpr double kLane = 26;

std::string number(double value, const char* format = "%.1f") {
  char text[32];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

// Steps of 1, 2 or 5 times a power of ten that divide `span` into at most `count` parts.
double tick_step(double span, int count) {
  double step = std::pow(10, std::floor(std::log10(std::max(1e-9, span) / count)));
  for (const double factor : {2.0, 2.5, 2.0}) {
    if (span / step > count) step *= factor;
  }
  return step;
}

std::string open_svg(const ChartAxes& axes, double height) {
  return "<svg viewBox=\"0 0 " + number(axes.width, "%g") + " " + number(height, "%g") +
         "\" role=\"img\" aria-label=\"" + html_escaped(axes.title) + "\" class=\"chart\">";
}

std::string line(double x0, double y0, double x1, double y1, const char* attributes) {
  return "<line x1=\"" + number(x0) + "\" y1=\"" + number(y0) + "\" x2=\"" + number(x1) +
         "\" y2=\"" + number(y1) + "\" " + attributes + "/>";
}

std::string label(double x, double y, const char* anchor, const std::string& text) {
  return "<text x=\"" + number(x) + "\" y=\"" + number(y) + "\" text-anchor=\"" + anchor + "\">" +
         html_escaped(text) + "</text>";
}

std::string box(double x, double y, double width, double height, const std::string& colour,
                const std::string& text = {}) {
  return "<rect x=\"" + number(x, "%.2f") + "\" y=\"" + number(y) + "\" width=\"" +
         number(width, "%.2f") + "\" height=\"" + number(height) + "\" fill=\"" + colour + "\"" +
         (text.empty() ? "/>" : "><title>" + html_escaped(text) + "</title></rect>");
}

// A drawing's scales: values to places.
struct Scales {
  double left, width, x_end, y_top, y_low = 0;
  double x(double value) const { return left + width * value / x_end; }
  double y(double value) const { return kTop + kHeight * (y_top - value) / (y_top - y_low); }
};

std::string x_ticks(const Scales& scales, const std::string& unit, double baseline) {
  std::string svg;
  const double step = tick_step(scales.x_end, 10);
  for (double t = 0; t <= scales.x_end + step * 1e-6; t += step) {
    svg += label(scales.x(t), baseline, "middle", number(t, "%g") + " " + unit);
  }
  return svg;
}

std::string y_ticks(const Scales& scales, const std::string& unit) {
  std::string svg;
  const double step = tick_step(scales.y_top - scales.y_low, 4);
  for (double k = std::ceil(scales.y_low / step); k * step <= scales.y_top + step * 1e-6; ++k) {
    const double y = scales.y(k * step);
    svg += line(scales.left, y, scales.left + scales.width, y, "class=\"grid\"");
    svg += label(scales.left - 8, y + 4, "end", number(k * step + 0.0, "%g") + " " + unit);
  }
  return svg;
}

std::string polyline(const Scales& scales, const ChartSeries& series) {
  std::string points;
  for (const auto& [x, y] : series.points) {
    points += number(scales.x(x)) + "," + number(scales.y(y)) + " ";
  }
  std::string svg;
  if (series.filled && !series.points.empty()) {
    svg += "<polygon fill=\"" + series.colour + "\" fill-opacity=\".16\" points=\"" +
           number(scales.x(series.points.front().first)) + "," + number(scales.y(0)) + " " +
           points + number(scales.x(series.points.back().first)) + "," + number(scales.y(0)) +
           "\"/>";
  }
  return svg + "<polyline fill=\"none\" stroke=\"" + series.colour +
         "\" stroke-width=\"2\" stroke-linejoin=\"round\" points=\"" + points + "\"/>";
}

std::string dots(const Scales& scales, const ChartSeries& series) {
  std::string path;
  for (const auto& [x, y] : series.points) {
    path += "M" + number(scales.x(x)) + " " + number(scales.y(y)) + "h0";
  }
  return "<path fill=\"none\" stroke=\"" + series.colour +
         "\" stroke-width=\"4\" stroke-linecap=\"round\" d=\"" + path + "\"/>";
}

double sum(const std::vector<double>& parts) {
  double total = 0;
  for (const double part : parts) total += part;
  return total;
}

double highest(const std::vector<Bar>& bars) {
  double top = 0;
  for (const Bar& bar : bars) top = std::max(top, sum(bar.parts));
  return top > 0 ? top : 1;
}

std::string tip(const Bar& bar, const BarKind& kind, double part, const std::string& unit) {
  return bar.label + ", " + kind.label + ": " + number(part, "%.3g") + " " + unit;
}

}  // namespace

std::string html_escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&': out += "&amp;"; break;
      case '<': out += "&lt;"; break;
      case '>': out += "&gt;"; break;
      case '"': out += "&quot;"; break;
      default: out += c;
    }
  }
  return out;
}

std::string render_legend(const std::vector<BarKind>& kinds) {
  std::string html = "<p class=\"legend\">";
  for (const BarKind& kind : kinds) {
    html += "<span><i style=\"background:" + kind.colour + "\"></i>" + html_escaped(kind.label) +
            "</span> ";
  }
  return html + "</p>";
}

std::string render_chart(const ChartAxes& axes, const std::vector<ChartSeries>& series) {
  Scales scales{kLeft, axes.width - kLeft - kRight, axes.x_end, axes.y_top};
  std::vector<BarKind> legend;
  for (const ChartSeries& one : series) {
    for (const auto& [x, y] : one.points) {
      if (axes.x_end == 0) scales.x_end = std::max(scales.x_end, x);
      if (axes.y_top == 0) scales.y_top = std::max(scales.y_top, y);
      scales.y_low = std::min(scales.y_low, y);
    }
    if (!one.label.empty()) legend.push_back({one.label, one.colour});
  }
  if (axes.y_top == 0) scales.y_top = std::max(scales.y_top, axes.mark_y);
  if (scales.x_end <= 0) scales.x_end = 1;
  if (scales.y_top <= 0) scales.y_top = 1;
  std::string svg = open_svg(axes, kTop + kHeight + kBottom) + y_ticks(scales, axes.y_unit) +
                    x_ticks(scales, axes.x_unit, kTop + kHeight + 20);
  for (const ChartSeries& one : series) {
    svg += one.dots ? dots(scales, one) : polyline(scales, one);
  }
  if (axes.mark_y > 0) {
    const double y = scales.y(axes.mark_y);
    svg += line(scales.left, y, scales.left + scales.width, y, "class=\"mark\"");
    svg += label(scales.left + scales.width, y + 16, "end", axes.mark);
  }
  return svg + "</svg>" + (legend.size() > 1 ? render_legend(legend) : "");
}

std::string render_bars(const ChartAxes& axes, const std::vector<BarKind>& kinds,
                        const std::vector<Bar>& bars) {
  const Scales scales{kLeft, axes.width - kLeft - kRight, 1,
                      axes.y_top > 0 ? axes.y_top : highest(bars)};
  std::string svg = open_svg(axes, kTop + kHeight + kBottom) + y_ticks(scales, axes.y_unit);
  const double pitch = scales.width / static_cast<double>(std::max<std::size_t>(1, bars.size()));
  for (std::size_t i = 0; i < bars.size(); ++i) {
    const double left = scales.left + pitch * static_cast<double>(i);
    double below = 0;
    for (std::size_t k = 0; k < bars[i].parts.size(); ++k) {
      const double part = bars[i].parts[k];
      svg += box(left + pitch * .12, scales.y(below + part), pitch * .76,
                 scales.y(below) - scales.y(below + part), kinds[k].colour,
                 tip(bars[i], kinds[k], part, axes.y_unit));
      below += part;
    }
    svg += label(left + pitch / 2, kTop + kHeight + 20, "middle", bars[i].label);
  }
  return svg + "</svg>" + (kinds.size() > 1 ? render_legend(kinds) : "");
}

std::string render_lying_bars(const ChartAxes& axes, const std::vector<BarKind>& kinds,
                              const std::vector<Bar>& bars) {
  const double height = kLane * static_cast<double>(bars.size());
  const Scales scales{kLabels, axes.width - kLabels - kRight,
                      axes.x_end > 0 ? axes.x_end : highest(bars), 1};
  std::string svg = open_svg(axes, kTop + height + kBottom);
  for (std::size_t i = 0; i < bars.size(); ++i) {
    const double top = kTop + kLane * static_cast<double>(i);
    svg += label(kLabels - 10, top + 17, "end", bars[i].label);
    double before = 0;
    for (std::size_t k = 0; k < bars[i].parts.size(); ++k) {
      const double part = bars[i].parts[k];
      if (part <= 0) continue;
      svg += box(scales.x(before), top + 3, scales.x(before + part) - scales.x(before), kLane - 6,
                 kinds[k].colour, tip(bars[i], kinds[k], part, axes.x_unit));
      before += part;
    }
  }
  return svg + x_ticks(scales, axes.x_unit, kTop + height + 20) + "</svg>" + render_legend(kinds);
}

std::string render_lanes(const ChartAxes& axes, const std::vector<BarKind>& kinds,
                         const std::vector<Lane>& lanes) {
  const double height = kLane * static_cast<double>(lanes.size());
  const Scales scales{kLabels, axes.width - kLabels - kRight, axes.x_end > 0 ? axes.x_end : 1, 1};
  std::string svg = open_svg(axes, kTop + height + kBottom);
  for (std::size_t i = 0; i < lanes.size(); ++i) {
    const double top = kTop + kLane * static_cast<double>(i);
    svg += label(kLabels - 10, top + 17, "end", lanes[i].label);
    double drawn = 0;  // what would be narrower than a third of a unit is left out
    for (const LaneSpan& span : lanes[i].spans) {
      const double right = scales.x(span.end);
      if (right - drawn < .33) continue;
      const double left = std::max(drawn, scales.x(span.begin));
      svg += box(left, top + 3, right - left, kLane - 6, kinds[span.kind].colour, span.text);
      drawn = right;
    }
  }
  return svg + x_ticks(scales, axes.x_unit, kTop + height + 20) + "</svg>" + render_legend(kinds);
}

}  // namespace ivfm::host

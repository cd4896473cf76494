#include "host/demo/demo_report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "host/log_analysis/map_picture.h"

namespace ivfm::host {
namespace {

constexpr const char* kStyle = R"css(
:root{--ink:#1f2933;--faint:#66707c;--line:#dfe3e8;--soft:#f6f7f9;--good:#1b7f5c;--bad:#c2255c}
*{box-sizing:border-box}
body{margin:0;background:#fff;color:var(--ink);font:16px/1.5 system-ui,"DejaVu Sans",sans-serif}
main{max-width:1180px;margin:0 auto;padding:40px 24px 64px}
h1{font-size:30px;line-height:1.2;margin:0 0 4px}h2{font-size:19px;margin:40px 0 12px}
p{margin:0 0 12px}.faint{color:var(--faint)}
.verdicts{display:flex;flex-wrap:wrap;gap:8px;margin:20px 0}
.verdict{border:1px solid;border-radius:99px;padding:3px 14px;font-weight:600;font-size:14px}
.good{color:var(--good)}.bad{color:var(--bad)}
.figures{display:grid;grid-template-columns:repeat(auto-fill,minmax(170px,1fr));gap:12px}
.figure{background:var(--soft);border-radius:10px;padding:14px 16px}
.figure b{display:block;font-size:24px;line-height:1.25;font-weight:650}
.figure span{display:block}.figure small{color:var(--faint)}
img,svg{display:block;width:100%;height:auto}
.frame{border:1px solid var(--line);border-radius:10px;overflow:hidden;padding:12px}
.wide{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
th,td{padding:8px 12px;border-bottom:1px solid var(--line);text-align:right;white-space:nowrap}
th{color:var(--faint);font-weight:500}th:first-child,td:first-child{text-align:left}
.dot{display:inline-block;width:10px;height:10px;border-radius:50%;margin-right:8px}
code,pre{font:14px/1.5 ui-monospace,"DejaVu Sans Mono",monospace}
pre{background:var(--soft);border-radius:10px;padding:14px 16px;overflow-x:auto;margin:0}
dl{display:grid;grid-template-columns:max-content 1fr;gap:4px 20px;margin:0}dd{margin:0}
)css";

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '&') {
      out += "&amp;";
    } else if (c == '<') {
      out += "&lt;";
    } else if (c == '>') {
      out += "&gt;";
    } else if (c == '"') {
      out += "&quot;";
    } else {
      out += c;
    }
  }
  return out;
}

// RFC 4648, section 4.
std::string base64(const std::string& bytes) {
  constexpr char kAlphabet[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      group = group << 8 | (i + k < bytes.size() ? static_cast<std::uint8_t>(bytes[i + k]) : 0u);
    }
    for (std::size_t k = 0; k < 4; ++k) {
      out += i + k > bytes.size() ? '=' : kAlphabet[group >> (18 - 6 * k) & 63];
    }
  }
  return out;
}

std::string number(double value, const char* format = "%.1f") {
  char text[32];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string embedded_picture(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  if (bytes.empty()) throw std::runtime_error("picture " + path.string() + " cannot be read");
  return "<img alt=\"Merged map with visits, obstacles and the robots' paths\" "
         "src=\"data:image/png;base64," +
         base64(bytes) + "\">";
}

std::string render_table(const DemoReport& report) {
  std::string html = "<div class=\"wide\"><table><thead><tr>";
  for (const std::string& head : report.table_head) html += "<th>" + escaped(head) + "</th>";
  html += "</tr></thead><tbody>";
  for (std::size_t robot = 0; robot < report.table.size(); ++robot) {
    html += "<tr>";
    for (std::size_t i = 0; i < report.table[robot].size(); ++i) {
      html += "<td>";
      if (i == 0) {
        html += "<span class=\"dot\" style=\"background:" + robot_colour(robot) + "\"></span>";
      }
      html += escaped(report.table[robot][i]) + "</td>";
    }
    html += "</tr>";
  }
  return html + "</tbody></table></div>";
}

// Two columns with a heading; nothing when there is nothing to list.
std::string render_list(const char* title, const std::vector<ReportFigure>& rows) {
  if (rows.empty()) return {};
  std::string html = std::string("\n<h2>") + title + "</h2><dl>";
  for (const ReportFigure& row : rows) {
    html += "<dt><code>" + escaped(row.value) + "</code></dt><dd>" + escaped(row.label) + "</dd>";
  }
  return html + "</dl>";
}

std::string render_figures(const std::vector<ReportFigure>& figures) {
  std::string html = "<div class=\"figures\">";
  for (const ReportFigure& figure : figures) {
    html += "<div class=\"figure\"><b>" + escaped(figure.value) + "</b><span>" +
            escaped(figure.label) + "</span><small>" + escaped(figure.note) + "</small></div>";
  }
  return html + "</div>";
}

// Steps of 1, 2 or 5 times a power of ten that divide `span` into at most `count` parts.
double tick_step(double span, int count) {
  double step = std::pow(10, std::floor(std::log10(span / count)));
  for (const double factor : {2.0, 2.5, 2.0}) {
    if (span / step > count) step *= factor;
  }
  return step;
}

// Places of the curve's drawing.
struct Plot {
  static constexpr double kLeft = 52, kTop = 14, kWidth = 1060, kHeight = 230;
  double end_s;
  double x(double time_s) const { return kLeft + kWidth * time_s / end_s; }
  double y(double share) const { return kTop + kHeight * (1 - share); }
};

std::string line(double x0, double y0, double x1, double y1, const char* attributes) {
  return "<line x1=\"" + number(x0) + "\" y1=\"" + number(y0) + "\" x2=\"" + number(x1) +
         "\" y2=\"" + number(y1) + "\" " + attributes + "/>";
}

std::string label(double x, double y, const char* anchor, const std::string& text) {
  return "<text x=\"" + number(x) + "\" y=\"" + number(y) + "\" text-anchor=\"" + anchor + "\">" +
         text + "</text>";
}

std::string render_axes(const Plot& plot) {
  std::string svg;
  for (int percent = 0; percent <= 100; percent += 25) {
    const double y = plot.y(percent / 100.0);
    svg += line(Plot::kLeft, y, Plot::kLeft + Plot::kWidth, y, "stroke=\"#dfe3e8\"");
    svg += label(Plot::kLeft - 8, y + 4, "end", std::to_string(percent) + " %");
  }
  const double step = tick_step(plot.end_s, 10);
  for (double t = 0; t <= plot.end_s + 1e-9; t += step) {
    svg += label(plot.x(t), Plot::kTop + Plot::kHeight + 20, "middle", number(t, "%g") + " s");
  }
  return svg;
}

}  // namespace

std::string render_coverage_curve(const std::vector<ProgressPoint>& progress, double goal) {
  const Plot plot{progress.empty() ? 1.0 : std::max(1.0, progress.back().time_s)};
  std::string svg =
      "<svg viewBox=\"0 0 1130 276\" role=\"img\" aria-label=\"Explored share over time\" "
      "font-size=\"13\" fill=\"#66707c\">" +
      render_axes(plot);
  if (!progress.empty()) {
    std::string points;
    for (const ProgressPoint& point : progress) {
      points += number(plot.x(point.time_s)) + "," + number(plot.y(point.explored)) + " ";
    }
    svg += "<polygon fill=\"#41ae8a\" fill-opacity=\".16\" points=\"" +
           number(plot.x(progress.front().time_s)) + "," + number(plot.y(0)) + " " + points +
           number(plot.x(progress.back().time_s)) + "," + number(plot.y(0)) + "\"/>";
    svg +=
        "<polyline fill=\"none\" stroke=\"#1b7f5c\" stroke-width=\"2.5\" "
        "stroke-linejoin=\"round\" points=\"" +
        points + "\"/>";
  }
  if (goal > 0) {
    svg += line(Plot::kLeft, plot.y(goal), Plot::kLeft + Plot::kWidth, plot.y(goal),
                "stroke=\"#d9480f\" stroke-dasharray=\"6 5\"");
    svg += label(Plot::kLeft + Plot::kWidth, plot.y(goal) - 6, "end",
                 "goal " + number(goal * 100, "%g") + " %");
  }
  return svg + "</svg>";
}

std::string render_report(const DemoReport& report) {
  std::string html =
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
      "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">"
      "<title>" +
      escaped(report.title) + "</title><style>" + kStyle + "</style></head><body><main>\n<h1>" +
      escaped(report.title) + "</h1><p class=\"faint\">" + escaped(report.subtitle) +
      "</p>\n<div class=\"verdicts\">";
  for (const Verdict& verdict : report.verdicts) {
    html += std::string("<span class=\"verdict ") + (verdict.good ? "good\">✓ " : "bad\">✗ ") +
            escaped(verdict.text) + "</span>";
  }
  html += "</div>\n" + render_figures(report.figures);
  if (!report.map_picture.empty()) {
    html += "\n<h2>Map</h2><div class=\"frame\">" + embedded_picture(report.map_picture) + "</div>";
  }
  html += "\n<h2>" + escaped(report.progress_title) + "</h2><div class=\"frame\">" +
          render_coverage_curve(report.progress, report.goal) + "</div>";
  html += "\n<h2>Robots</h2>" + render_table(report);
  html += render_list("What happened", report.events) + render_list("Files", report.files);
  if (!report.command.empty()) {
    html += "\n<h2>Run it again</h2><pre>" + escaped(report.command) + "</pre>\n";
  }
  return html + "</main></body></html>\n";
}

}  // namespace ivfm::host

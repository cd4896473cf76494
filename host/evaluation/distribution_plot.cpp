#include "host/evaluation/distribution_plot.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "host/log_analysis/map_picture.h"

namespace ivfm::host {

namespace {

constexpr double kWidth = 760, kHeight = 400;
constexpr double kLeft = 56, kRight = 20, kTop = 44, kBottom = 48;

std::vector<double> sorted_steps(const Outcome& outcome) {
  std::vector<double> steps;
  for (const EpisodeMetrics& e : outcome.result.episodes) {
    if (e.found) steps.push_back(std::max(1.0, e.steps));
  }
  std::ranges::sort(steps);
  return steps;
}

class Axes {
 public:
  explicit Axes(double most) : decades_(std::log10(std::max(10.0, most))) {}
  std::string x(double steps) const {
    return fixed(kLeft + (kWidth - kLeft - kRight) * std::log10(steps) / decades_, 1);
  }
  std::string y(double share) const {
    return fixed(kTop + (kHeight - kTop - kBottom) * (1 - share), 1);
  }

 private:
  double decades_;
};

std::string text(const std::string& x, const std::string& y, const char* style,
                 const std::string& content) {
  return "<text x='" + x + "' y='" + y + "' " + style + ">" + content + "</text>\n";
}

std::string line(const std::string& x1, const std::string& y1, const std::string& x2,
                 const std::string& y2) {
  return "<line x1='" + x1 + "' y1='" + y1 + "' x2='" + x2 + "' y2='" + y2 +
         "' stroke='#dfe3e8'/>\n";
}

std::string grid(const Axes& axes, double most) {
  std::string svg;
  for (const double share : {0.0, 0.25, 0.5, 0.75, 1.0}) {
    svg += line(axes.x(1), axes.y(share), axes.x(most), axes.y(share));
    svg += text(fixed(kLeft - 8, 0), axes.y(share - 0.01), "text-anchor='end'",
                fixed(100 * share, 0) + " %");
  }
  for (const double steps :
       {1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0}) {
    if (steps > most) break;
    svg += line(axes.x(steps), axes.y(0), axes.x(steps), axes.y(1));
    svg += text(axes.x(steps), fixed(kHeight - kBottom + 18, 0), "text-anchor='middle'",
                fixed(steps, 0));
  }
  return svg + text(fixed((kLeft + kWidth) / 2, 0), fixed(kHeight - 8, 0), "text-anchor='middle'",
                    "steps until the target was found (median in brackets)");
}

std::string curve(const Axes& axes, const std::vector<double>& steps, std::size_t episodes,
                  const std::string& colour) {
  std::string svg = "<polyline fill='none' stroke-width='2' stroke='" + colour + "' points='";
  double share = 0;
  const auto go_to = [&](double at) { (((svg += axes.x(at)) += ',') += axes.y(share)) += ' '; };
  go_to(1);
  for (const double at : steps) {
    go_to(at);
    share += 1 / static_cast<double>(episodes);
    go_to(at);
  }
  return svg + "'/>\n";
}

}  // namespace

std::string distribution_svg(const std::string& title, std::span<const Outcome> outcomes) {
  std::vector<std::vector<double>> all;
  double most = 10;
  for (const Outcome& outcome : outcomes) {
    all.push_back(sorted_steps(outcome));
    if (!all.back().empty()) most = std::max(most, all.back().back());
  }
  const Axes axes(most);
  std::string svg = "<svg xmlns='http://www.w3.org/2000/svg' width='" + fixed(kWidth, 0) +
                    "' height='" + fixed(kHeight, 0) +
                    "' font-family='DejaVu Sans, sans-serif' font-size='12' fill='#1f2933'>\n"
                    "<rect width='100%' height='100%' fill='white'/>\n";
  svg += text(fixed(kLeft, 0), "24", "font-size='16'", title) + grid(axes, most);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const std::size_t episodes = outcomes[i].result.episodes.size();
    const std::string colour = robot_colour(i);
    svg += curve(axes, all[i], episodes, colour);
    const std::size_t middle = episodes / 2;
    const std::string median = middle < all[i].size() ? fixed(all[i][middle], 0) : "–";
    const std::string place = fixed(kTop + 18 + 18 * static_cast<double>(i), 0);
    svg += text(fixed(kLeft + 12, 0), place, ("font-weight='600' fill='" + colour + "'").c_str(),
                outcomes[i].contestant.label + " (" + median + ")");
  }
  return svg + "</svg>\n";
}

}  // namespace ivfm::host

#include "host/trainer/curve_log.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>
#include <stdexcept>

#include "host/trainer/atomic_file.h"

namespace ivfm::host {
namespace {

constexpr double kEmpty = std::numeric_limits<double>::quiet_NaN();
constexpr int kPanelWidth = 420, kPanelHeight = 200, kMargin = 48, kPanelsPerRow = 2;

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> fields;
  std::stringstream in(line);
  for (std::string field; std::getline(in, field, ',');) fields.push_back(field);
  if (!line.empty() && line.back() == ',') fields.emplace_back();
  return fields;
}

std::string join(const std::vector<std::string>& fields) {
  std::string line = "step";
  for (const std::string& field : fields) line += "," + field;
  return line;
}

std::string number(double value) {
  if (std::isnan(value)) return "";
  std::ostringstream out;
  out.precision(6);
  out << value;
  return out.str();
}

struct Extent {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();
  void include(double v) {
    low = std::min(low, v);
    high = std::max(high, v);
  }
};

// One panel: the curve of `column` inside a frame whose upper left corner is (x0, y0).
void draw_panel(std::ostream& out, const std::string& name, const std::vector<long>& steps,
                const std::vector<std::vector<double>>& rows, std::size_t column, int x0, int y0) {
  Extent x, y;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (std::isnan(rows[i][column])) continue;
    x.include(static_cast<double>(steps[i]));
    y.include(rows[i][column]);
  }
  const double w = kPanelWidth - 2 * kMargin, h = kPanelHeight - 2 * kMargin;
  const int left = x0 + kMargin, top = y0 + kMargin;
  out << "<rect x='" << left << "' y='" << top << "' width='" << w << "' height='" << h
      << "' fill='none' stroke='#999'/><text x='" << left << "' y='" << top - 8 << "'>" << name
      << "</text>\n";
  if (!(x.low <= x.high)) return;
  const double span_x = std::max(x.high - x.low, 1.0), span_y = std::max(y.high - y.low, 1e-9);
  out << "<polyline fill='none' stroke='#1f6fb4' points='";
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (std::isnan(rows[i][column])) continue;
    out << left + w * (static_cast<double>(steps[i]) - x.low) / span_x << ','
        << top + h * (1 - (rows[i][column] - y.low) / span_y) << ' ';
  }
  out << "'/><text x='" << left - 4 << "' y='" << top + 10 << "' text-anchor='end'>"
      << number(y.high) << "</text><text x='" << left - 4 << "' y='" << top + h
      << "' text-anchor='end'>" << number(y.low) << "</text><text x='" << left + w << "' y='"
      << top + h + 14 << "' text-anchor='end'>step " << number(x.high) << "</text>\n";
}

}  // namespace

CurveLog::CurveLog(std::string path, std::vector<std::string> columns, long resume_step)
    : path_(std::move(path)), columns_(std::move(columns)) {
  std::ifstream in(path_);
  std::string line;
  if (resume_step > 0 && std::getline(in, line)) {
    if (line != join(columns_))
      throw std::runtime_error(path_ + ": its columns are not \"" + join(columns_) + "\"");
    while (std::getline(in, line)) {
      const std::vector<std::string> fields = split(line);
      if (fields.size() != columns_.size() + 1) continue;
      const long step = std::stol(fields[0]);
      if (step > resume_step) break;
      std::vector<double> row;
      for (std::size_t i = 1; i < fields.size(); ++i)
        row.push_back(fields[i].empty() ? kEmpty : std::stod(fields[i]));
      steps_.push_back(step);
      rows_.push_back(std::move(row));
    }
  }
  rewrite();
}

void CurveLog::rewrite() const {
  write_atomically(path_, [this](const std::string& temporary) {
    std::ofstream out(temporary);
    out << join(columns_) << '\n';
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      out << steps_[i];
      for (const double value : rows_[i]) out << ',' << number(value);
      out << '\n';
    }
    if (!out.flush()) throw std::runtime_error("disk full or folder not writable");
  });
}

void CurveLog::add(long step, const std::vector<double>& values) {
  steps_.push_back(step);
  rows_.push_back(values);
  std::ofstream out(path_, std::ios::app);
  out << step;
  for (const double value : values) out << ',' << number(value);
  out << '\n';
  if (!out.flush()) throw std::runtime_error("cannot append to " + path_);
}

void CurveLog::plot(const std::string& svg_path) const {
  write_atomically(svg_path, [this](const std::string& temporary) {
    std::ofstream out(temporary);
    const int panels = static_cast<int>(columns_.size());
    const int lines = (panels + kPanelsPerRow - 1) / kPanelsPerRow;
    out << "<svg xmlns='http://www.w3.org/2000/svg' font-family='sans-serif' font-size='11' width='"
        << kPanelsPerRow * kPanelWidth << "' height='" << lines * kPanelHeight
        << "'><rect width='100%' height='100%' fill='white'/>\n";
    for (int i = 0; i < panels; ++i)
      draw_panel(out, columns_[static_cast<std::size_t>(i)], steps_, rows_,
                 static_cast<std::size_t>(i), i % kPanelsPerRow * kPanelWidth,
                 i / kPanelsPerRow * kPanelHeight);
    out << "</svg>\n";
    if (!out.flush()) throw std::runtime_error("disk full or folder not writable");
  });
}

}  // namespace ivfm::host

// Training curves: a CSV file that grows by a row a report, and an SVG plot of its columns.
#pragma once

#include <string>
#include <vector>

namespace ivfm::host {

// Appends to `path`, cutting what a killed run wrote after row `resume_step`.
class CurveLog {
 public:
  // The first column is "step". Throws std::runtime_error when the file cannot be written or
  // holds other columns.
  CurveLog(std::string path, std::vector<std::string> columns, long resume_step);

  // `values`: one a column after "step"; not-a-number leaves the field empty.
  void add(long step, const std::vector<double>& values);
  // Draws every column against the step, one panel each, into `svg_path` (replaced atomically).
  void plot(const std::string& svg_path) const;

 private:
  void rewrite() const;

  std::string path_;
  std::vector<std::string> columns_;
  std::vector<long> steps_;
  std::vector<std::vector<double>> rows_;
};

}  // namespace ivfm::host

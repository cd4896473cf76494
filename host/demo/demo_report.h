// The report of a run as one self-contained HTML page.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace ivfm::host {

// A yes/no verdict at the top of the page.
struct Verdict {
  bool good = false;
  std::string text;
};

struct ReportFigure {
  std::string value;  // with its unit
  std::string label;
  std::string note;  // may be empty
};

// The fleet at one moment of the run.
struct ProgressPoint {
  double time_s = 0;    // simulated
  double explored = 0;  // share 0..1
  double driven_m = 0;
};

struct DemoReport {
  std::string title;
  std::string subtitle;
  std::vector<Verdict> verdicts;
  std::vector<ReportFigure> figures;
  std::filesystem::path map_picture;  // PNG, put into the page
  double goal = 0;                    // share that was aimed at; 0: none
  std::vector<ProgressPoint> progress;
  std::vector<std::string> table_head;
  std::vector<std::vector<std::string>> table;  // one row a robot; the first column is its name
  std::vector<ReportFigure> events;             // value: when; label: what; may be empty
  std::vector<ReportFigure> files;              // value: name; label: what it is
  std::string progress_title = "Explored over time";
  std::string command;  // how to run it again; may be empty
};

// The page. Throws std::runtime_error when the picture cannot be read.
std::string render_report(const DemoReport& report);

// Explored share over time as an SVG drawing.
std::string render_coverage_curve(const std::vector<ProgressPoint>& progress, double goal);

}  // namespace ivfm::host

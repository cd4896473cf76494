// The report of a run as one self-contained HTML page.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "host/log_analysis/run_data.h"

namespace ivfm::host {

// A yes/no verdict at the top of the page.
struct Verdict {
  bool good = false;
  std::string text;
};

// What the database does not know of a run.
struct ReportExtras {
  std::string title;     // empty: the file's name
  std::string subtitle;  // empty: the run in short
  std::vector<Verdict> verdicts;
  double goal = 0;                                         // share that was aimed at; 0: none
  std::vector<std::pair<std::string, std::string>> files;  // name, what it is
  std::string command;                                     // how to run it again; may be empty
};

// "2 robots, 132 s, 280.1 m² explored, 45.1 m driven".
std::string describe(const RunData& run);

// The map with the robots' paths and goals. Throws std::runtime_error when there is no map.
cv::Mat draw_run(const RunData& run);

// The page. `map`: draw_run()'s or another picture of the map; may be empty.
std::string render_run_report(const RunData& run, const std::vector<TimelineEntry>& timeline,
                              const cv::Mat& map, const ReportExtras& extras = {});

// A page with this project's look. `body` is HTML.
std::string html_page(const std::string& title, const std::string& body);
// A table; the first column is left-aligned, the rest are numbers. The texts are escaped here.
std::string html_table(const std::vector<std::string>& head,
                       const std::vector<std::vector<std::string>>& rows);
// A picture inside the page.
std::string html_picture(const cv::Mat& picture, const std::string& description);

}  // namespace ivfm::host

// A table of texts, for a terminal and for Markdown.
#pragma once

#include <string>
#include <vector>

namespace ivfm::host {

struct TextTable {
  struct Entry {
    std::string text;
    bool is_best = false;    // of several to compare with: '*' in text, italics in Markdown
    bool is_better = false;  // than that: '+' in text, bold in Markdown
  };
  using Row = std::vector<Entry>;

  std::vector<std::string> header;
  std::vector<Row> rows;  // as long as the header

  // The first column to the left, the others to the right.
  std::string to_text() const;
  std::string to_markdown() const;
};

// "0.301 ± 0.020" with so many digits after the point.
std::string with_error(double value, double standard_error, int digits);
// A number with so many digits after the point.
std::string fixed(double value, int digits);

}  // namespace ivfm::host

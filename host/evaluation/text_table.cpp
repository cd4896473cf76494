#include "host/evaluation/text_table.h"

#include <algorithm>
#include <cstdio>

namespace ivfm::host {

namespace {

// Columns on a terminal: UTF-8 continuation bytes take none.
std::size_t width_of(const std::string& text) {
  return static_cast<std::size_t>(
      std::ranges::count_if(text, [](char c) { return (c & 0xc0) != 0x80; }));
}

std::string marked_text(const TextTable::Entry& entry) {
  return entry.text + (entry.is_best ? "*" : entry.is_better ? "+" : " ");
}

std::string marked_markdown(const TextTable::Entry& entry) {
  if (entry.is_best) return "_" + entry.text + "_";
  return entry.is_better ? "**" + entry.text + "**" : entry.text;
}

}  // namespace

std::string TextTable::to_text() const {
  std::vector<std::size_t> widths;
  for (const std::string& name : header) widths.push_back(width_of(name) + 1);
  for (const Row& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      widths[i] = std::max(widths[i], width_of(row[i].text) + 1);
    }
  }
  std::string out;
  const auto add = [&](std::size_t column, const std::string& text) {
    const std::string space(widths[column] - width_of(text) + 1, ' ');
    out += column == 0 ? text + space : space + text;
  };
  for (std::size_t i = 0; i < header.size(); ++i) add(i, header[i] + " ");
  out += '\n';
  for (const Row& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) add(i, marked_text(row[i]));
    out += '\n';
  }
  return out;
}

std::string TextTable::to_markdown() const {
  std::string out = "|", rule = "|";
  for (const std::string& name : header) {
    ((out += ' ') += name) += " |";
    rule += &name == &header.front() ? " --- |" : " ---: |";
  }
  out += "\n" + rule + "\n";
  for (const Row& row : rows) {
    out += "|";
    for (const Entry& entry : row) ((out += ' ') += marked_markdown(entry)) += " |";
    out += "\n";
  }
  return out;
}

std::string fixed(double value, int digits) {
  char text[48];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

std::string with_error(double value, double standard_error, int digits) {
  return fixed(value, digits) + " ± " + fixed(standard_error, digits);
}

}  // namespace ivfm::host

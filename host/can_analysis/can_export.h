// Parts of CAN logs, and their signals, as files for other tools.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <string>

namespace ivfm::host {

// Which frames.
struct CanSelection {
  std::string bus;  // empty: every bus
  // Seconds since the log's first frame.
  double from_s = 0, to_s = std::numeric_limits<double>::infinity();
};

// Both answer the number of rows written and throw std::runtime_error with one sentence when the
// log cannot be read or the output cannot be written. `progress` is called with the percentage.

// The frames as candump -L writes them, bit by bit as they were.
std::uint64_t export_candump(const std::filesystem::path& log, const CanSelection& selection,
                             const std::filesystem::path& out,
                             const std::function<void(std::uint64_t)>& progress = {});
// time_s,bus,message,signal,value,unit of every signal that the shipped DBC file describes.
std::uint64_t export_signals_csv(const std::filesystem::path& log, const CanSelection& selection,
                                 const std::filesystem::path& out,
                                 const std::function<void(std::uint64_t)>& progress = {});

}  // namespace ivfm::host

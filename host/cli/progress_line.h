// The line that tells on a terminal how far a long command is, and when it will be done.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

namespace ivfm::host {

// "[####      ] 40 of 100 episodes, 12 s left"; without an estimate before the first is finished.
std::string progress_text(std::uint64_t finished, std::uint64_t total, const std::string& unit,
                          double elapsed_s);
// A duration as people say it: "8 s", "3 min 20 s", "2 h 5 min".
std::string duration_text(double seconds);

// Writes to stderr when it is a terminal, from half a second on and five times a second; wipes the
// line at the end. Elsewhere it does nothing.
class ProgressLine {
 public:
  explicit ProgressLine(std::uint64_t total = 0, std::string unit = {});
  ~ProgressLine();
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  // `finished` of the total are done.
  void operator()(std::uint64_t finished);
  // A line of one's own for work whose end is not known, at most once a second.
  void say(const std::string& line);
  // A line at once, for a step that tells nothing until it is over.
  void begin_step(const std::string& line);

 private:
  using Clock = std::chrono::steady_clock;
  bool is_due(Clock::duration period);

  std::uint64_t total_;
  std::string unit_;
  bool terminal_;
  bool drawn_ = false;
  Clock::time_point begin_ = Clock::now();
  Clock::time_point next_ = begin_ + std::chrono::milliseconds(500);
};

}  // namespace ivfm::host

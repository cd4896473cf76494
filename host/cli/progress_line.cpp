#include "host/cli/progress_line.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

namespace ivfm::host {

std::string duration_text(double seconds) {
  const auto whole = static_cast<std::int64_t>(std::llround(std::max(0.0, seconds)));
  if (whole < 60) return std::to_string(whole) + " s";
  if (whole < 3600) {
    return std::to_string(whole / 60) + " min " + std::to_string(whole % 60) + " s";
  }
  return std::to_string(whole / 3600) + " h " + std::to_string(whole / 60 % 60) + " min";
}

std::string progress_text(std::uint64_t finished, std::uint64_t total, const std::string& unit,
                          double elapsed_s) {
  constexpr std::uint64_t kWidth = 30;
  total = std::max<std::uint64_t>(1, total);
  finished = std::min(finished, total);
  std::string text = "[";
  text.append(kWidth * finished / total, '#');
  text.resize(kWidth + 1, ' ');
  text += "] " + std::to_string(finished) + " of " + std::to_string(total) + " " + unit;
  if (finished == 0) return text;
  const double left_s =
      elapsed_s * static_cast<double>(total - finished) / static_cast<double>(finished);
  return text + ", " + duration_text(left_s) + " left";
}

ProgressLine::ProgressLine(std::uint64_t total, std::string unit)
    : total_(total), unit_(std::move(unit)), terminal_(::isatty(STDERR_FILENO) == 1) {}

ProgressLine::~ProgressLine() {
  if (drawn_) std::fputs("\r\033[K", stderr);
}

bool ProgressLine::is_due(Clock::duration period) {
  if (!terminal_) return false;
  const auto now = Clock::now();
  if (now < next_) return false;
  next_ = now + period;
  drawn_ = true;
  return true;
}

void ProgressLine::operator()(std::uint64_t finished) {
  if (!is_due(std::chrono::milliseconds(200))) return;
  const double elapsed_s = std::chrono::duration<double>(Clock::now() - begin_).count();
  std::fprintf(stderr, "\r%s\033[K", progress_text(finished, total_, unit_, elapsed_s).c_str());
  std::fflush(stderr);
}

void ProgressLine::say(const std::string& line) {
  if (is_due(std::chrono::seconds(1))) begin_step(line);
}

void ProgressLine::begin_step(const std::string& line) {
  if (!terminal_) return;
  drawn_ = true;
  std::fprintf(stderr, "\r%s\033[K", line.c_str());
  std::fflush(stderr);
}

}  // namespace ivfm::host

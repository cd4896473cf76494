#include "host/can_analysis/can_log.h"

#include <charconv>
#include <fstream>
#include <stdexcept>

namespace ivfm::host {
namespace {

// The word before the next space; the rest stays in `line`.
std::string_view next_word(std::string_view& line) {
  const std::size_t begin = line.find_first_not_of(" \t");
  if (begin == std::string_view::npos) return {};
  const std::size_t end = std::min(line.find_first_of(" \t\r", begin), line.size());
  const std::string_view word = line.substr(begin, end - begin);
  line.remove_prefix(end);
  return word;
}

template <typename T>
bool parse_all(std::string_view text, T& value, int base) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  return error == std::errc() && end == text.data() + text.size();
}

// "1436509052.249713" in seconds.
bool parse_time(std::string_view text, double& seconds) {
  const std::size_t dot = text.find('.');
  std::uint64_t whole = 0, fraction = 0;
  if (dot == std::string_view::npos || !parse_all(text.substr(0, dot), whole, 10)) return false;
  const std::string_view digits = text.substr(dot + 1);
  if (digits.empty() || digits.size() > 9 || !parse_all(digits, fraction, 10)) return false;
  double unit = 1;
  for (std::size_t i = 0; i < digits.size(); ++i) unit /= 10;
  seconds = static_cast<double>(whole) + static_cast<double>(fraction) * unit;
  return true;
}

bool parse_payload(std::string_view text, CanLogFrame& frame) {
  if (!text.empty() && (text[0] == 'R' || text[0] == 'r')) {
    frame.remote = true;
    return text.size() == 1 || (text.size() == 2 && parse_all(text.substr(1), frame.size, 16));
  }
  if (text.size() % 2 != 0 || text.size() > 16) return false;
  frame.size = static_cast<std::uint8_t>(text.size() / 2);
  for (std::size_t i = 0; i < frame.size; ++i) {
    if (!parse_all(text.substr(2 * i, 2), frame.data[i], 16)) return false;
  }
  return true;
}

}  // namespace

std::optional<CanLogFrame> parse_candump(std::string_view line) {
  CanLogFrame frame;
  const std::string_view time = next_word(line);
  if (time.size() < 3 || time.front() != '(' || time.back() != ')' ||
      !parse_time(time.substr(1, time.size() - 2), frame.time_s)) {
    return std::nullopt;
  }
  frame.bus = std::string(next_word(line));
  const std::string_view body = next_word(line);
  const std::size_t hash = body.find('#');
  if (frame.bus.empty() || hash == std::string_view::npos || hash + 1 > body.size()) {
    return std::nullopt;
  }
  frame.extended = hash > 3;
  const std::uint32_t most = frame.extended ? 0x1fffffff : 0x7ff;
  if (!parse_all(body.substr(0, hash), frame.id, 16) || frame.id > most) return std::nullopt;
  if (!parse_payload(body.substr(hash + 1), frame)) return std::nullopt;
  return frame;
}

CanLogCounters read_can_log(const std::filesystem::path& file,
                            const std::function<void(const CanLogFrame&)>& take,
                            const std::function<void(std::uint64_t)>& progress) {
  std::ifstream in(file, std::ios::binary);
  if (!in || std::filesystem::is_directory(file)) {
    throw std::runtime_error("CAN log '" + file.string() + "' cannot be read");
  }
  CanLogCounters counters;
  std::string line;
  while (std::getline(in, line)) {
    counters.bytes += line.size() + 1;
    if (line.empty()) continue;
    if (const auto frame = parse_candump(line)) {
      ++counters.frames;
      take(*frame);
    } else if (++counters.malformed >= 1000 && counters.frames == 0) {
      break;  // no candump log, and perhaps a large one
    }
    if (progress && (counters.frames & 8191u) == 0) progress(counters.bytes);
  }
  if (counters.frames == 0) {
    throw std::runtime_error("'" + file.string() +
                             "' holds no line of candump -L, such as "
                             "'(1436509052.249713) can0 123#AABB'");
  }
  return counters;
}

}  // namespace ivfm::host

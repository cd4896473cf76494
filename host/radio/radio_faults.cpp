#include "host/radio/radio_faults.h"

#include <array>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "host/cli/take_text.h"

namespace ivfm::host {
namespace {

constexpr double kMaxRate = 1e9;

constexpr std::array<std::pair<std::string_view, double RadioFaults::*>, 5> kProbabilities{{
    {"drop=", &RadioFaults::drop},
    {"duplicate=", &RadioFaults::duplicate},
    {"reorder=", &RadioFaults::reorder},
    {"corrupt=", &RadioFaults::corrupt},
    {"truncate=", &RadioFaults::truncate},
}};
constexpr std::array<std::pair<std::string_view, TimeUs RadioFaults::*>, 2> kTimes{{
    {"delay=", &RadioFaults::delay_us},
    {"jitter=", &RadioFaults::jitter_us},
}};

[[noreturn]] void fail(std::string_view text, const std::string& what) {
  throw std::invalid_argument("radio fault '" + std::string(text) + "': " + what +
                              "; write for example drop=0.3, duplicate=0.1, reorder=0.1, "
                              "corrupt=0.01, truncate=0.01, delay=20ms, jitter=100ms, rate=10000 "
                              "or partition@30s+60s");
}

TimeUs require_time(std::string_view text, std::string_view& rest) {
  const std::optional<TimeUs> time = take_time(rest);
  if (!time) fail(text, "a time is missing or wrong, or has no unit, s or ms");
  return *time;
}

RadioFaults::Partition take_partition(std::string_view text, std::string_view& rest) {
  const TimeUs begin_us = require_time(text, rest);
  if (!take_prefix(rest, "+")) return {begin_us, std::numeric_limits<TimeUs>::max()};
  return {begin_us, begin_us + require_time(text, rest)};
}

bool take_value(RadioFaults& faults, std::string_view text, std::string_view& rest) {
  for (const auto& [name, member] : kProbabilities) {
    if (!take_prefix(rest, name)) continue;
    const std::optional<double> probability = take_number(rest);
    if (!probability || *probability > 1) fail(text, "the probability must be 0 to 1");
    faults.*member = *probability;
    return true;
  }
  for (const auto& [name, member] : kTimes) {
    if (!take_prefix(rest, name)) continue;
    faults.*member = require_time(text, rest);
    return true;
  }
  if (take_prefix(rest, "rate=")) {
    const std::optional<double> rate = take_number(rest);
    if (!rate || *rate < 1 || *rate > kMaxRate) fail(text, "the rate must be 1 to 1e9 bytes/s");
    faults.bytes_per_second = static_cast<std::uint64_t>(*rate);
    return true;
  }
  if (!take_prefix(rest, "partition@")) return false;
  faults.partitions.push_back(take_partition(text, rest));
  return true;
}

void add_one(RadioFaults& faults, std::string_view text) {
  std::string_view rest = text;
  if (!take_value(faults, text, rest)) fail(text, "the name is unknown");
  if (!rest.empty()) fail(text, "'" + std::string(rest) + "' is left over");
}

}  // namespace

void add_radio_faults(RadioFaults& faults, std::string_view text) {
  while (true) {
    const std::size_t comma = text.find(',');
    add_one(faults, text.substr(0, comma));
    if (comma == std::string_view::npos) return;
    text.remove_prefix(comma + 1);
  }
}

}  // namespace ivfm::host

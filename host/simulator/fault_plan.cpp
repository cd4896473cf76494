#include "host/simulator/fault_plan.h"

#include <array>
#include <charconv>
#include <optional>
#include <stdexcept>
#include <utility>

#include "host/cli/take_text.h"

namespace ivfm::host {
namespace {

constexpr std::array<std::pair<std::string_view, FaultKind>, 6> kNames{{
    {"lidar-silence", FaultKind::kLidarSilence},
    {"lidar-garbage", FaultKind::kLidarGarbage},
    {"can-drop", FaultKind::kCanDrop},
    {"drive-fault", FaultKind::kDriveFault},
    {"drive-silence", FaultKind::kDriveSilence},
    {"left-drive-silence", FaultKind::kLeftDriveSilence},
}};

[[noreturn]] void fail(std::string_view text, const std::string& what) {
  throw std::invalid_argument("fault '" + std::string(text) + "': " + what +
                              "; write for example lidar-silence@12s+3s, lidar-garbage#2@5s, "
                              "can-drop=0.1, drive-fault@20s or drive-silence@20s+500ms");
}

TimeUs require_time(std::string_view text, std::string_view& rest) {
  const std::optional<TimeUs> time = take_time(rest);
  if (!time) fail(text, "a time is missing or wrong, or has no unit, s or ms");
  return *time;
}

FaultKind take_kind(std::string_view text, std::string_view& rest) {
  for (const auto& [name, kind] : kNames) {
    if (!rest.starts_with(name)) continue;
    rest.remove_prefix(name.size());
    return kind;
  }
  fail(text, "the name is unknown");
}

int take_robot(std::string_view text, std::string_view& rest) {
  if (!rest.starts_with('#')) return 0;
  rest.remove_prefix(1);
  int robot = 0;
  const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), robot);
  if (error != std::errc() || robot < 1) fail(text, "the robot after # must be 1 or more");
  rest.remove_prefix(static_cast<std::size_t>(end - rest.data()));
  return robot;
}

}  // namespace

Fault parse_fault(std::string_view text) {
  std::string_view rest = text;
  Fault fault{.kind = take_kind(text, rest)};
  fault.robot = take_robot(text, rest);
  if (fault.kind == FaultKind::kCanDrop) {
    if (!rest.starts_with('=')) fail(text, "can-drop needs = and a probability");
    rest.remove_prefix(1);
    const std::optional<double> probability = take_number(rest);
    if (!probability || *probability > 1) fail(text, "the probability must be 0 to 1");
    fault.probability = *probability;
  } else {
    if (!rest.starts_with('@')) fail(text, "the time it begins at is missing");
    rest.remove_prefix(1);
    fault.begin_us = require_time(text, rest);
    if (rest.starts_with('+')) {
      rest.remove_prefix(1);
      fault.end_us = fault.begin_us + require_time(text, rest);
    }
  }
  if (!rest.empty()) fail(text, "'" + std::string(rest) + "' is left over");
  return fault;
}

std::vector<Fault> parse_faults(const std::vector<std::string>& texts) {
  std::vector<Fault> faults;
  for (const std::string& text : texts) faults.push_back(parse_fault(text));
  return faults;
}

}  // namespace ivfm::host

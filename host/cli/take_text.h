// Reading numbers and times off the front of an option's text.
#pragma once

#include <charconv>
#include <cmath>
#include <optional>
#include <string_view>

#include "firmware/hal/clock.h"

namespace ivfm::host {

// Each shortens `rest` by what it has read; nothing when `rest` does not begin with one.

// A finite number, 0 or more, without exponent.
inline std::optional<double> take_number(std::string_view& rest) {
  double value = 0;
  const auto [end, error] =
      std::from_chars(rest.data(), rest.data() + rest.size(), value, std::chars_format::fixed);
  if (error != std::errc() || !std::isfinite(value) || value < 0) return std::nullopt;
  rest.remove_prefix(static_cast<std::size_t>(end - rest.data()));
  return value;
}

// A time with its unit, such as 12s, 1.5s or 300ms; at most 1e9 of them.
inline std::optional<TimeUs> take_time(std::string_view& rest) {
  std::string_view after = rest;
  const std::optional<double> value = take_number(after);
  if (!value || *value > 1e9) return std::nullopt;
  const bool ms = after.starts_with("ms");
  if (!ms && !after.starts_with('s')) return std::nullopt;
  after.remove_prefix(ms ? 2 : 1);
  rest = after;
  return static_cast<TimeUs>(std::llround(*value * (ms ? 1e3 : 1e6)));
}

inline bool take_prefix(std::string_view& rest, std::string_view prefix) {
  if (!rest.starts_with(prefix)) return false;
  rest.remove_prefix(prefix.size());
  return true;
}

}  // namespace ivfm::host

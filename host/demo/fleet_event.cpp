#include "host/demo/fleet_event.h"

#include <charconv>
#include <stdexcept>
#include <string>

#include "host/cli/take_text.h"

namespace ivfm::host {
namespace {

constexpr int kMaxRobot = 8;

std::optional<int> take_robot(std::string_view& rest) {
  int robot = 0;
  const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), robot);
  if (error != std::errc() || robot < 1 || robot > kMaxRobot) return std::nullopt;
  rest.remove_prefix(static_cast<std::size_t>(end - rest.data()));
  return robot;
}

}  // namespace

FleetEvent parse_fleet_event(FleetEvent::Kind kind, std::string_view text) {
  const bool may_return = kind != FleetEvent::Kind::kJoin;
  const auto fail = [text, may_return] {
    return std::invalid_argument("'" + std::string(text) + "' is not ROBOT@TIME such as 2@30s" +
                                 (may_return ? ", or 2@30s+10s to start again" : ""));
  };
  std::string_view rest = text;
  const auto robot = take_robot(rest);
  if (!robot || !take_prefix(rest, "@")) throw fail();
  const auto at_us = take_time(rest);
  if (!at_us) throw fail();
  FleetEvent event{kind, *robot, *at_us, {}};
  if (may_return && take_prefix(rest, "+")) {
    const auto pause_us = take_time(rest);
    if (!pause_us) throw fail();
    event.again_us = *at_us + *pause_us;
  }
  if (!rest.empty()) throw fail();
  return event;
}

}  // namespace ivfm::host

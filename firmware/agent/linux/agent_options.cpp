#include "firmware/agent/linux/agent_options.h"

#include <toml++/toml.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iostream>
#include <sstream>
#include <variant>
#include <vector>

namespace ivfm {
namespace {

using TextMember = std::string AgentOptions::*;
using NumberMember = double AgentOptions::*;
using IntegerMember = std::int64_t AgentOptions::*;
using SwitchMember = bool AgentOptions::*;
using ProfileMember = ProfileChoice AgentOptions::*;
using GoalsMember = GoalsChoice AgentOptions::*;
using LocalizationMember = LocalizationChoice AgentOptions::*;
using TelemetryMember = TelemetryFormat AgentOptions::*;
struct StartPose {};

using Member = std::variant<TextMember, NumberMember, IntegerMember, SwitchMember, ProfileMember,
                            GoalsMember, LocalizationMember, TelemetryMember, StartPose>;

// One option: its name in the file and, after "--", on the command line. `low`, `high` bound
// numbers.
struct Option {
  const char* name;
  Member member;
  const char* help;
  double low = 0;
  double high = 0;
};

const std::array kOptions{
    Option{"lidar", &AgentOptions::lidar, "Serial device of the RPLIDAR, or a pseudo-terminal"},
    Option{"can", &AgentOptions::can, "CAN bus: socketcan:IFACE or socketcand:HOST:PORT/BUS"},
    Option{"server", &AgentOptions::server, "Map server, HOST:PORT; without it the radio is off"},
    Option{"robot-id", &AgentOptions::robot_id, "Number of this robot in its team", 1, 250},
    Option{"key", &AgentOptions::key,
           "File with this robot's radio key (ivfm keygen); needed by a server on another machine"},
    Option{"plain-radio", &AgentOptions::plain_radio, "Go without a key to other machines, too"},
    Option{"radio-rate", &AgentOptions::radio_rate,
           "Most bytes a second that the radio sends, 0 for no limit", 0, 100'000'000},
    Option{"model", &AgentOptions::model,
           "Quantized policy; without it frontiers alone are weighed"},
    Option{"profile", &AgentOptions::profile, "Map size and resolution: paper, robot or mcu"},
    Option{"goals", &AgentOptions::goals,
           "views (of frontiers; the network's goal where its view shows more) or network (alone, "
           "as in the paper)"},
    Option{"localization", &AgentOptions::localization,
           "matching (scans against the map correct the odometry) or odometry"},
    Option{"start", StartPose{}, "Pose at start-up: X,Y,HEADING in metres and degrees"},
    Option{"rough-start", &AgentOptions::rough_start,
           "The start pose may be 0.5 m and 15 degrees wrong: correct it by the others' map"},
    Option{"unknown-start", &AgentOptions::unknown_start,
           "The start pose is not known: explore apart until the server has found it"},
    Option{"target", &AgentOptions::target,
           "X,Y in metres: the robot that sees this place ends the search for all"},
    Option{"return-home", &AgentOptions::return_home, "Drive back to the start when done"},
    Option{"time-scale", &AgentOptions::time_scale, "Run the clock this many times faster", 0.1,
           100},
    Option{"visit-range", &AgentOptions::visit_range_m, "Reach of a visit, metres", 0.1, 12},
    Option{"visit-fov", &AgentOptions::visit_fov_deg, "Angle of a visit, degrees", 1, 360},
    Option{"max-speed", &AgentOptions::max_speed_m_s, "Largest speed, m/s", 0.01, 5},
    Option{"max-turn", &AgentOptions::max_turn_rad_s, "Largest turn rate, rad/s", 0.05, 10},
    Option{"robot-radius", &AgentOptions::robot_radius_m, "Radius of the robot, metres", 0.02, 1},
    Option{"wheel-radius", &AgentOptions::wheel_radius_m, "Radius of a drive wheel, metres", 0.005,
           0.5},
    Option{"wheel-base", &AgentOptions::wheel_base_m, "Distance between the wheels, metres", 0.02,
           2},
    Option{"counts-per-rev", &AgentOptions::counts_per_rev, "Encoder counts per wheel turn", 16,
           16'777'216},
    Option{"dump-map", &AgentOptions::dump_map, "File for the map, written at the end"},
    Option{"telemetry", &AgentOptions::telemetry, "Once a second on stderr: line, json or off"},
    Option{"log-file", &AgentOptions::log_file, "File for the log instead of stderr"},
};

// Where a value was written: "agent.toml:12: wheel-radius" or "--wheel-radius".
struct Place {
  std::string text;
  [[noreturn]] void fail(const std::string& what) const { throw OptionsError(text + ": " + what); }
};

std::string plain(double value) {
  std::ostringstream out;
  out << value;
  return out.str();
}

double checked_range(const Option& option, double value, const Place& place) {
  if (!(value >= option.low && value <= option.high)) {
    place.fail(plain(value) + " is out of range; right is " + plain(option.low) + " to " +
               plain(option.high));
  }
  return value;
}

// What an option may be, and how that is called.
template <typename Choice>
struct Named {
  const char* name;
  Choice choice;
};
constexpr std::array kProfiles{Named{"paper", ProfileChoice::kPaper},
                               Named{"robot", ProfileChoice::kRobot},
                               Named{"mcu", ProfileChoice::kMcu}};
constexpr std::array kGoals{Named{"views", GoalsChoice::kViews},
                            Named{"network", GoalsChoice::kNetwork}};
constexpr std::array kLocalizations{Named{"odometry", LocalizationChoice::kOdometry},
                                    Named{"matching", LocalizationChoice::kMatching}};
constexpr std::array kTelemetry{Named{"line", TelemetryFormat::kLine},
                                Named{"json", TelemetryFormat::kJson},
                                Named{"off", TelemetryFormat::kOff}};

// Of an option that is one of several.
const auto& names_of(ProfileMember) { return kProfiles; }
const auto& names_of(GoalsMember) { return kGoals; }
const auto& names_of(LocalizationMember) { return kLocalizations; }
const auto& names_of(TelemetryMember) { return kTelemetry; }

template <typename Choice, std::size_t N>
Choice choose(const std::array<Named<Choice>, N>& all, const std::string& text,
              const Place& place) {
  std::string right;  // a, b or c
  for (std::size_t i = 0; i < N; ++i) {
    if (text == all[i].name) return all[i].choice;
    right += std::string(i == 0 ? "" : (i + 1 == N ? " or " : ", ")) + all[i].name;
  }
  place.fail("'" + text + "' is wrong; right is " + right);
}

template <typename Choice, std::size_t N>
std::string name_of(const std::array<Named<Choice>, N>& all, Choice choice) {
  for (const Named<Choice>& named : all) {
    if (choice == named.choice) return named.name;
  }
  return {};
}

constexpr double kFarthestM = 2'000;  // micrometres in 32 bits reach 2.1 km

void set_start(AgentOptions& options, const std::array<double, 3>& pose, const Place& place) {
  for (const double value : pose) {
    if (!std::isfinite(value)) place.fail("right are three finite numbers: X,Y,HEADING");
  }
  if (std::abs(pose[0]) > kFarthestM || std::abs(pose[1]) > kFarthestM) {
    place.fail("the start is too far out; right is within 2000 m of the map's origin");
  }
  options.start_x_m = pose[0];
  options.start_y_m = pose[1];
  options.start_heading_deg = pose[2];
}

template <typename... F>
struct Overloaded : F... {
  using F::operator()...;
};
template <typename... F>
Overloaded(F...) -> Overloaded<F...>;

// --- the file -------------------------------------------------------------------------------

template <typename T>
T typed(const toml::node& node, const char* right, const Place& place) {
  const auto value = node.value_exact<T>();
  if (!value) place.fail(std::string("wrong type; right is ") + right);
  return *value;
}

double number(const toml::node& node, const Place& place) {
  if (!node.is_number()) place.fail("wrong type; right is a number");
  return *node.value<double>();
}

void set_from_node(AgentOptions& options, const Option& option, const toml::node& node,
                   const Place& place) {
  std::visit(
      Overloaded{
          [&](TextMember m) { options.*m = typed<std::string>(node, "a string", place); },
          [&](NumberMember m) { options.*m = checked_range(option, number(node, place), place); },
          [&](IntegerMember m) {
            const auto value = typed<std::int64_t>(node, "a whole number", place);
            checked_range(option, static_cast<double>(value), place);
            options.*m = value;
          },
          [&](SwitchMember m) { options.*m = typed<bool>(node, "true or false", place); },
          [&](StartPose) {
            const toml::array* pose = node.as_array();
            if (pose == nullptr || pose->size() != 3) {
              place.fail("wrong type; right is an array of three numbers: [x, y, heading]");
            }
            set_start(
                options,
                {number((*pose)[0], place), number((*pose)[1], place), number((*pose)[2], place)},
                place);
          },
          [&](auto m) {
            options.*m = choose(names_of(m), typed<std::string>(node, "a string", place), place);
          }},
      option.member);
}

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t changed = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({changed, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row.back();
}

std::string nearest_name(std::string_view key) {
  const auto nearer = [&](const Option& a, const Option& b) {
    return edit_distance(key, a.name) < edit_distance(key, b.name);
  };
  return std::min_element(kOptions.begin(), kOptions.end(), nearer)->name;
}

// --- the command line -----------------------------------------------------------------------

double to_number(std::string_view text, const Place& place) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) {
    place.fail("'" + std::string(text) + "' is not a number");
  }
  return value;
}

std::int64_t to_integer(const std::string& text, const Place& place) {
  const double value = to_number(text, place);
  if (value != std::floor(value) || std::abs(value) > 9e15) {
    place.fail("'" + text + "' is not a whole number");
  }
  return static_cast<std::int64_t>(value);
}

std::array<double, 3> to_pose(const std::string& text, const Place& place) {
  std::vector<std::string> parts;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, ',');) parts.push_back(part);
  if (parts.size() != 3) place.fail("'" + text + "' is not X,Y,HEADING, for example 1.5,2,90");
  return {to_number(parts[0], place), to_number(parts[1], place), to_number(parts[2], place)};
}

void set_from_text(AgentOptions& options, const Option& option, const std::string& text) {
  const Place place{std::string("--") + option.name};
  std::visit(Overloaded{[&](TextMember m) { options.*m = text; },
                        [&](NumberMember m) {
                          options.*m = checked_range(option, to_number(text, place), place);
                        },
                        [&](IntegerMember m) {
                          const std::int64_t value = to_integer(text, place);
                          checked_range(option, static_cast<double>(value), place);
                          options.*m = value;
                        },
                        [&](SwitchMember m) {
                          if (text != "true" && text != "false") {
                            place.fail("'" + text + "' is wrong; right is true or false");
                          }
                          options.*m = text == "true";
                        },
                        [&](StartPose) { set_start(options, to_pose(text, place), place); },
                        [&](auto m) { options.*m = choose(names_of(m), text, place); }},
             option.member);
}

// As --help shows it: what holds where nothing is said.
std::string default_text(const Option& option) {
  const AgentOptions options;
  return std::visit(Overloaded{[&](TextMember m) { return options.*m; },
                               [&](NumberMember m) { return plain(options.*m); },
                               [&](IntegerMember m) { return std::to_string(options.*m); },
                               [&](SwitchMember) { return std::string(); },  // off
                               [&](StartPose) { return std::string("0,0,0"); },
                               [&](auto m) { return name_of(names_of(m), options.*m); }},
                    option.member);
}

std::string read_file(const std::string& path) {
  std::ifstream in(path);
  if (!in) throw OptionsError("--config: cannot read " + path);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

// The options as CLI11 knows them, and the texts that it fills in.
struct CommandLine {
  CommandLine() {
    app.footer(
        "Example: ivfm-agent --lidar /dev/ttyUSB0 --can socketcan:can0 --server 10.0.0.1:7700 \\\n"
        "           --key robot1.key --model models/explorer.ivfm --start 0,0,90\n"
        "Every option but --config is also a key of the TOML file; see agent.example.toml.");
    app.set_version_flag("--version", "ivfm-agent 0.1.0");
    app.add_option("--config", config, "TOML file with any of these options; flags win over it");
    for (std::size_t i = 0; i < kOptions.size(); ++i) {
      const std::string flag = std::string("--") + kOptions[i].name;
      const bool is_switch = std::holds_alternative<SwitchMember>(kOptions[i].member);
      flags[i] = app.add_option(flag, texts[i], kOptions[i].help);
      if (is_switch) flags[i]->expected(0, 1)->default_str("true")->option_text(" ");
      if (const std::string text = default_text(kOptions[i]); !text.empty()) {
        flags[i]->option_text("=" + text);
      }
    }
  }
  CommandLine(const CommandLine&) = delete;
  CommandLine& operator=(const CommandLine&) = delete;

  CLI::App app{"ivfm-agent: explores with an RPLIDAR and two CiA 402 wheel drives", "ivfm-agent"};
  std::string config;
  std::array<std::string, kOptions.size()> texts;
  std::array<CLI::Option*, kOptions.size()> flags{};
};

// --- what has to fit together ---------------------------------------------------------------

bool is_host_and_port(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos || colon == 0) return false;
  int port = 0;
  const char* end = text.data() + text.size();
  const auto [last, error] = std::from_chars(text.data() + colon + 1, end, port);
  return error == std::errc() && last == end && port >= 1 && port <= 65535;
}

bool is_can_bus(const std::string& text) {
  constexpr std::string_view kSocketCan = "socketcan:", kSocketCand = "socketcand:";
  if (text.starts_with(kSocketCan)) return text.size() > kSocketCan.size();
  const std::size_t slash = text.find('/');
  return text.starts_with(kSocketCand) && slash != std::string::npos && slash + 1 < text.size() &&
         is_host_and_port(text.substr(kSocketCand.size(), slash - kSocketCand.size()));
}

void check_together(const AgentOptions& options) {
  if (options.lidar.empty()) {
    throw OptionsError("no lidar given; right is --lidar PATH, for example /dev/ttyUSB0");
  }
  if (!is_can_bus(options.can)) {
    throw OptionsError("can: '" + options.can +
                       "' is no CAN bus; right is socketcan:can0 or socketcand:HOST:PORT/BUS");
  }
  if (options.radio_rate != 0 && options.radio_rate < 1000) {
    throw OptionsError("radio-rate: right is 0 for no limit, or 1000 bytes a second at least");
  }
  if (options.rough_start && options.unknown_start) {
    throw OptionsError("rough-start and unknown-start: right is one of them");
  }
  if (!options.target.empty() && !parse_place(options.target)) {
    throw OptionsError("target: '" + options.target + "' is not X,Y, for example 12.5,-3");
  }
  if (!options.server.empty() && !is_host_and_port(options.server)) {
    throw OptionsError("server: '" + options.server + "' is not HOST:PORT");
  }
}

}  // namespace

std::optional<std::array<double, 2>> parse_place(const std::string& text) {
  std::array<double, 2> place{};
  const char* at = text.data();
  const char* const end = at + text.size();
  for (std::size_t i = 0; i < place.size(); ++i) {
    if (i > 0 && (at == end || *at++ != ',')) return std::nullopt;
    const auto [after, error] = std::from_chars(at, end, place[i]);
    if (error != std::errc() || !(std::abs(place[i]) <= kFarthestM)) return std::nullopt;
    at = after;
  }
  return at == end ? std::optional(place) : std::nullopt;
}

void apply_toml(AgentOptions& options, const std::string& text, const std::string& file_name) {
  toml::table table;
  try {
    table = toml::parse(text, file_name);
  } catch (const toml::parse_error& error) {
    throw OptionsError(file_name + ":" + std::to_string(error.source().begin.line) + ": " +
                       std::string(error.description()));
  }
  for (const auto& [key, node] : table) {
    const std::string name(key.str());
    const std::string line = file_name + ":" + std::to_string(key.source().begin.line) + ": ";
    const auto option = std::find_if(kOptions.begin(), kOptions.end(),
                                     [&](const Option& o) { return o.name == name; });
    if (option == kOptions.end()) {
      throw OptionsError(line + "unknown key '" + name + "'; the nearest one is '" +
                         nearest_name(name) + "'");
    }
    set_from_node(options, *option, node, Place{line + name});
  }
}

std::optional<AgentOptions> parse_agent_options(int argc, const char* const* argv) {
  CommandLine line;
  try {
    line.app.parse(argc, argv);
  } catch (const CLI::Success& asked) {
    line.app.exit(asked);
    return std::nullopt;
  } catch (const CLI::ParseError& error) {
    throw OptionsError(std::string(error.what()) + "; --help lists the options");
  }
  AgentOptions options;
  if (!line.config.empty()) apply_toml(options, read_file(line.config), line.config);
  for (std::size_t i = 0; i < kOptions.size(); ++i) {
    if (line.flags[i]->count() > 0) set_from_text(options, kOptions[i], line.texts[i]);
  }
  check_together(options);
  return options;
}

void show_agent_command_line(const std::function<void(const CLI::App&)>& show) {
  const CommandLine line;
  show(line.app);
}

}  // namespace ivfm

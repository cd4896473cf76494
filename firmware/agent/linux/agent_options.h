// The options of ivfm-agent: from the command line and a TOML file.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <stdexcept>
#include <string>

namespace CLI {
class App;
}

namespace ivfm {

enum class ProfileChoice : std::uint8_t { kPaper, kRobot, kMcu };
enum class GoalsChoice : std::uint8_t { kViews, kNetwork };
enum class LocalizationChoice : std::uint8_t { kOdometry, kMatching };
enum class TelemetryFormat : std::uint8_t { kLine, kJson, kOff };

// Every member is a key of the file and, with the same name, a flag (agent_options.cpp lists them).
struct AgentOptions {
  std::string lidar;   // serial device or pseudo-terminal
  std::string can;     // socketcan:IFACE or socketcand:HOST:PORT/BUS
  std::string server;  // HOST:PORT; empty: no radio
  std::int64_t robot_id = 1;
  std::string key;              // file with this robot's radio key; empty: no encryption
  bool plain_radio = false;     // goes without a key even when the server is another machine
  std::int64_t radio_rate = 0;  // bytes a second that may be sent; 0: no limit
  std::string
      model;  // quantized Q-network; empty: goes by what the views from frontiers would show
  ProfileChoice profile = ProfileChoice::kRobot;
  GoalsChoice goals = GoalsChoice::kViews;
  LocalizationChoice localization = LocalizationChoice::kMatching;
  double start_x_m = 0;  // pose in the map at start-up
  double start_y_m = 0;
  double start_heading_deg = 0;
  bool rough_start = false;    // that pose may be 0.5 m and 15 degrees wrong
  bool unknown_start = false;  // that pose tells nothing: the map stays apart until it is found
  std::string target;          // X,Y in metres: the search is over once it was seen; empty: none
  bool return_home = false;    // drives back to the start when all is explored
  double time_scale = 1;       // the agent's clock runs this many times faster
  double visit_range_m = 3;    // footprint of a visit: reach and angle, centred ahead
  double visit_fov_deg = 360;
  double max_speed_m_s = 0.22;
  double max_turn_rad_s = 1.5;
  double robot_radius_m = 0.105;
  double wheel_radius_m = 0.033;
  double wheel_base_m = 0.16;  // between the wheels
  std::int64_t counts_per_rev = 4096;
  std::string dump_map;  // written at the end; empty: not
  TelemetryFormat telemetry = TelemetryFormat::kLine;
  std::string log_file;  // empty: standard error
};

// What was wrong, where, and what would be right; one sentence.
class OptionsError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// The place that "X,Y" names, in metres; no value when it is none within 2000 m of the origin.
std::optional<std::array<double, 2>> parse_place(const std::string& text);

// The command line; flags win over the file named by --config. No value: --help or --version was
// asked for and printed; the program is done. Throws OptionsError.
std::optional<AgentOptions> parse_agent_options(int argc, const char* const* argv);

// Shows the options that --help lists, for man pages and completions.
void show_agent_command_line(const std::function<void(const CLI::App&)>& show);

// Sets what the TOML text says on top of `options`. `file_name` is for messages. Throws
// OptionsError: "FILE:LINE: ...".
void apply_toml(AgentOptions& options, const std::string& text, const std::string& file_name);

}  // namespace ivfm

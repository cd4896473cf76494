#include "firmware/agent/linux/agent_options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <random>
#include <sstream>
#include <vector>

namespace ivfm {
namespace {

using ::testing::HasSubstr;

std::optional<AgentOptions> parse(std::initializer_list<const char*> arguments) {
  std::vector<const char*> argv{"ivfm-agent"};
  argv.insert(argv.end(), arguments);
  return parse_agent_options(static_cast<int>(argv.size()), argv.data());
}

std::string error_of_flags(std::initializer_list<const char*> arguments) {
  std::vector<const char*> argv{"ivfm-agent", "--lidar", "/dev/ttyUSB0"};
  argv.insert(argv.end(), arguments);
  try {
    parse_agent_options(static_cast<int>(argv.size()), argv.data());
  } catch (const OptionsError& error) {
    return error.what();
  }
  return "no error";
}

std::string error_of_toml(const std::string& text) {
  AgentOptions options;
  try {
    apply_toml(options, text, "agent.toml");
  } catch (const OptionsError& error) {
    return error.what();
  }
  return "no error";
}

std::string read_source_file(const std::string& path) {
  std::ifstream in(IVFM_SOURCE_DIR "/" + path);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

TEST(AgentOptions, FlagsSetEveryKindOfValue) {
  const auto options = parse({"--lidar",
                              "/dev/pts/3",
                              "--can",
                              "socketcand:127.0.0.1:29536/robot1",
                              "--server",
                              "localhost:7777",
                              "--robot-id",
                              "2",
                              "--model",
                              "m.ivfm",
                              "--profile",
                              "paper",
                              "--start",
                              "1.5,-2,90",
                              "--time-scale",
                              "4",
                              "--visit-range",
                              "2.5",
                              "--max-speed",
                              "0.25",
                              "--wheel-radius",
                              "0.04",
                              "--wheel-base",
                              "0.3",
                              "--counts-per-rev",
                              "2048",
                              "--dump-map",
                              "map.bin",
                              "--telemetry",
                              "json",
                              "--log-file",
                              "a.log",
                              "--return-home",
                              "--rough-start",
                              "--plain-radio"});
  ASSERT_TRUE(options);
  EXPECT_EQ(options->lidar, "/dev/pts/3");
  EXPECT_EQ(options->can, "socketcand:127.0.0.1:29536/robot1");
  EXPECT_EQ(options->server, "localhost:7777");
  EXPECT_EQ(options->robot_id, 2);
  EXPECT_EQ(options->model, "m.ivfm");
  EXPECT_EQ(options->profile, ProfileChoice::kPaper);
  EXPECT_EQ(options->start_x_m, 1.5);
  EXPECT_EQ(options->start_y_m, -2);
  EXPECT_EQ(options->start_heading_deg, 90);
  EXPECT_EQ(options->time_scale, 4);
  EXPECT_EQ(options->visit_range_m, 2.5);
  EXPECT_EQ(options->max_speed_m_s, 0.25);
  EXPECT_EQ(options->wheel_radius_m, 0.04);
  EXPECT_EQ(options->wheel_base_m, 0.3);
  EXPECT_EQ(options->counts_per_rev, 2048);
  EXPECT_EQ(options->dump_map, "map.bin");
  EXPECT_EQ(options->telemetry, TelemetryFormat::kJson);
  EXPECT_EQ(options->log_file, "a.log");
  EXPECT_TRUE(options->return_home);
  EXPECT_TRUE(options->rough_start);
  EXPECT_TRUE(options->plain_radio);
}

TEST(AgentOptions, TheExampleFileHoldsEveryDefault) {
  AgentOptions options;
  options.wheel_base_m = 9;
  options.time_scale = 9;
  options.counts_per_rev = 9;
  apply_toml(options, read_source_file("firmware/agent/agent.example.toml"), "example");
  const AgentOptions defaults;
  EXPECT_EQ(options.lidar, "/dev/ttyUSB0");
  EXPECT_EQ(options.can, "socketcan:can0");
  EXPECT_EQ(options.wheel_base_m, defaults.wheel_base_m);
  EXPECT_EQ(options.time_scale, defaults.time_scale);
  EXPECT_EQ(options.counts_per_rev, defaults.counts_per_rev);
  EXPECT_EQ(options.visit_range_m, defaults.visit_range_m);
  EXPECT_EQ(options.robot_radius_m, defaults.robot_radius_m);
  EXPECT_EQ(options.max_turn_rad_s, defaults.max_turn_rad_s);
}

TEST(AgentOptions, TheExampleFileNamesEveryFlagOfTheHelp) {
  ::testing::internal::CaptureStdout();
  EXPECT_FALSE(parse({"--help"}));
  std::istringstream help(::testing::internal::GetCapturedStdout());
  const std::string example = read_source_file("firmware/agent/agent.example.toml");
  int flags = 0;
  for (std::string word; help >> word;) {
    word = word.substr(0, word.find('='));
    if (!word.starts_with("--") || word == "--config" || word == "--help" || word == "--version") {
      continue;
    }
    if (word == "--model" && flags > 18) continue;
    EXPECT_THAT(example, HasSubstr(word.substr(2) + " = ")) << word;
    ++flags;
  }
  EXPECT_GE(flags, 21);
}

TEST(AgentOptions, AFlagWinsOverTheFile) {
  const auto path = std::filesystem::temp_directory_path() /
                    ("agent_options_test_" + std::to_string(std::random_device{}()) + ".toml");
  std::ofstream(path) << "lidar = 'a'\ncan = 'socketcan:can1'\nrobot-id = 7\nmax-speed = 0.2\n";
  const auto options = parse({"--config", path.c_str(), "--robot-id", "8"});
  std::filesystem::remove(path);
  ASSERT_TRUE(options);
  EXPECT_EQ(options->can, "socketcan:can1");
  EXPECT_EQ(options->robot_id, 8);
  EXPECT_EQ(options->max_speed_m_s, 0.2);
}

TEST(AgentOptions, MistakesInTheFileNameTheLineAndWhatWouldBeRight) {
  EXPECT_EQ(error_of_toml("lidar = 'a'\nwheel_radius = 0.1\n"),
            "agent.toml:2: unknown key 'wheel_radius'; the nearest one is 'wheel-radius'");
  EXPECT_EQ(error_of_toml("\n\nlidar = 3\n"), "agent.toml:3: lidar: wrong type; right is a string");
  EXPECT_EQ(error_of_toml("max-speed = 'fast'"),
            "agent.toml:1: max-speed: wrong type; right is a number");
  EXPECT_EQ(error_of_toml("robot-id = 1.5"),
            "agent.toml:1: robot-id: wrong type; right is a whole number");
  EXPECT_EQ(error_of_toml("robot-id = 300"),
            "agent.toml:1: robot-id: 300 is out of range; right is 1 to 250");
  EXPECT_EQ(error_of_toml("max-speed = nan"),
            "agent.toml:1: max-speed: nan is out of range; right is 0.01 to 5");
  EXPECT_THAT(error_of_toml("start = [1, 2]"), HasSubstr("right is an array of three numbers"));
  EXPECT_THAT(error_of_toml("start = [1, 2, 'x']"), HasSubstr("right is a number"));
  EXPECT_THAT(error_of_toml("start = [1e9, 2, 3]"), HasSubstr("within 2000 m"));
  EXPECT_THAT(error_of_toml("profile = 'big'"), HasSubstr("right is paper, robot or mcu"));
  EXPECT_THAT(error_of_toml("return-home = 'yes'"), HasSubstr("right is true or false"));
  EXPECT_THAT(error_of_toml("lidar = 'a'\nlidar = 'b'\n"), HasSubstr("agent.toml:2: "));
  EXPECT_THAT(error_of_toml("lidar = "), HasSubstr("agent.toml:1: "));
}

TEST(AgentOptions, MistakesInFlagsNameTheFlagAndWhatWouldBeRight) {
  EXPECT_EQ(error_of_flags({"--can", "socketcan:can0"}), "no error");
  EXPECT_EQ(error_of_flags({"--max-speed", "9"}),
            "--max-speed: 9 is out of range; right is 0.01 to 5");
  EXPECT_EQ(error_of_flags({"--max-speed", "0.3x"}), "--max-speed: '0.3x' is not a number");
  EXPECT_EQ(error_of_flags({"--robot-id", "1.5"}), "--robot-id: '1.5' is not a whole number");
  EXPECT_THAT(error_of_flags({"--start", "1,2"}), HasSubstr("X,Y,HEADING"));
  EXPECT_THAT(error_of_flags({"--can", "can0"}), HasSubstr("right is socketcan:can0"));
  EXPECT_THAT(error_of_flags({"--can", "socketcand:host/bus"}), HasSubstr("no CAN bus"));
  EXPECT_THAT(error_of_flags({"--can", "socketcan:can0", "--server", "host:99999"}),
              HasSubstr("not HOST:PORT"));
  EXPECT_THAT(error_of_flags({"--speed", "1"}), HasSubstr("--help lists the options"));
  EXPECT_THAT(error_of_flags({"--config", "/no/such/file"}), HasSubstr("cannot read /no/such"));
  for (const char* place : {"1", "1,", ",1", "1,2,3", "1;2", "nan,1", "1,3000"}) {
    EXPECT_THAT(error_of_flags({"--can", "socketcan:can0", "--target", place}),
                HasSubstr("is not X,Y"));
  }
  EXPECT_THAT(error_of_flags({"--can", "socketcan:can0", "--radio-rate", "999"}),
              HasSubstr("1000 bytes a second at least"));
}

TEST(AgentOptions, RandomBytesInTheFileAreRefusedInOneSentence) {
  std::mt19937 random(11);
  const std::string example = read_source_file("firmware/agent/agent.example.toml");
  for (int i = 0; i < 300; ++i) {
    std::string text = example.substr(0, random() % example.size());
    for (int k = 0; k < 5 && !text.empty(); ++k) {
      text[random() % text.size()] = static_cast<char>(random());
    }
    const std::string error = error_of_toml(text);
    EXPECT_TRUE(error == "no error" || error.starts_with("agent.toml:")) << error;
  }
}

}  // namespace
}  // namespace ivfm

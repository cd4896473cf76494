#include "host/map_server/keygen_command.h"

#include <iostream>
#include <memory>
#include <stdexcept>
#include <system_error>

#include "firmware/hal/linux/radio_key_file.h"

namespace ivfm::host {
namespace fs = std::filesystem;

void write_team_keys(int robots, const fs::path& folder, std::ostream& out) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) {
    throw std::runtime_error("cannot create the folder " + folder.string() + ": " +
                             error.message());
  }
  const fs::path team = folder / "server.keys";
  RadioKeys keys = fs::exists(team) ? read_radio_keys(team) : RadioKeys{};
  const std::size_t before = keys.size();
  for (int robot = 1; robot <= robots; ++robot) {
    const auto id = static_cast<std::uint16_t>(robot);
    if (!keys.contains(id)) keys[id] = draw_radio_key();
  }
  write_radio_keys(team, keys);
  for (const auto& [robot, key] : keys) {
    write_radio_keys(folder / ("robot" + std::to_string(robot) + ".key"), {{robot, key}});
  }
  out << keys.size() - before << " new keys; " << team.string()
      << " for ivfm serve, robotN.key for "
      << "each of " << keys.size() << (keys.size() == 1 ? " robot" : " robots") << std::endl;
}

void add_keygen_command(CLI::App& app, CommandAction& action) {
  struct Options {
    int robots = 2;
    std::string out = "keys";
  };
  auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("keygen", "Make the radio keys of a team");
  command->add_option("--robots", options->robots, "robots 1 .. N; those with a key keep it")
      ->check(CLI::Range(1, 65535))
      ->capture_default_str();
  command->add_option("--out", options->out, "folder for server.keys and robotN.key, mode 600")
      ->capture_default_str();
  command->footer(
      "Copy each robotN.key to its robot, and nowhere else. To shut a robot out, delete its line "
      "in\n"
      "server.keys and start the server again.\n"
      "Example: ivfm keygen --robots 5 --out keys");
  command->callback([options, &action] {
    action = [options] {
      write_team_keys(options->robots, options->out, std::cout);
      return 0;
    };
  });
}

}  // namespace ivfm::host

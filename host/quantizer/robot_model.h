// A robot's model file on the host: what `ivfm-agent` would load.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "firmware/nn/q_network.h"

namespace ivfm::host {

// Reads a whole file. Throws std::runtime_error with the path.
std::vector<std::uint8_t> read_model_file(const std::filesystem::path& path);
// The same for a file that RobotModel takes; throws as that does.
std::vector<std::uint8_t> read_robot_model(const std::filesystem::path& path);

// The Q-network of a model file, and the bytes that it points into. Stays where it was made.
class RobotModel {
 public:
  // Throws std::runtime_error with the path and what is wrong: the file cannot be read, is no
  // model, or is one for another state than robots encode.
  explicit RobotModel(const std::filesystem::path& path);
  RobotModel(const RobotModel&) = delete;
  RobotModel& operator=(const RobotModel&) = delete;

  QNetwork& network() { return network_; }
  const std::vector<std::uint8_t>& bytes() const { return bytes_; }

 private:
  std::vector<std::uint8_t> bytes_;
  QNetwork network_;
};

}  // namespace ivfm::host

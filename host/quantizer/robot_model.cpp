#include "host/quantizer/robot_model.h"

#include <fstream>
#include <iterator>
#include <memory>
#include <stdexcept>

namespace ivfm::host {

std::vector<std::uint8_t> read_model_file(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::vector<char> bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  if (!in) throw std::runtime_error("cannot read the model " + path.string());
  return {bytes.begin(), bytes.end()};
}

std::vector<std::uint8_t> read_robot_model(const std::filesystem::path& path) {
  return std::make_unique<RobotModel>(path)->bytes();
}

RobotModel::RobotModel(const std::filesystem::path& path) : bytes_(read_model_file(path)) {
  const ModelStatus status = network_.load_for_robot(bytes_);
  if (!ok(status.status)) {
    throw std::runtime_error("cannot use the model " + path.string() + ": " + status.reason);
  }
}

}  // namespace ivfm::host

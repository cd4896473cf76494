// A pseudo-terminal whose far end other programs open under a name of our choice.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace ivfm::host {

// Owns both ends: the far end stays open here, so that programs may come and go. Bytes only: a
// pseudo-terminal has no modem lines, so DTR, the lidar's motor, cannot cross it; an emulator
// behind it must take a scan request for "motor on".
class PseudoTerminal {
 public:
  // `link` becomes a symbolic link to the far end, e.g. DIR/robot1.lidar; a link that is there
  // already is replaced. Throws std::runtime_error that names the path when it cannot.
  explicit PseudoTerminal(std::filesystem::path link);
  // Removes the link, if it is still ours.
  ~PseudoTerminal();
  PseudoTerminal(const PseudoTerminal&) = delete;
  PseudoTerminal& operator=(const PseudoTerminal&) = delete;

  const std::filesystem::path& link() const { return link_; }
  const std::string& device() const { return device_; }
  // To wait on with poll().
  int fd() const { return near_fd_; }

  // What the program at the far end wrote; empty when nothing is waiting. Never blocks.
  std::vector<std::uint8_t> read();
  // Passes on as much as the far end takes and returns how much that was: when nobody reads there,
  // the rest is lost like on a wire.
  std::size_t write(std::span<const std::uint8_t> bytes);

 private:
  void close_all();

  std::filesystem::path link_;
  std::string device_;
  int near_fd_ = -1;
  int far_fd_ = -1;
};

}  // namespace ivfm::host

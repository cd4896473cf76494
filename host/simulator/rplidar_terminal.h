// An emulated RPLIDAR on a pseudo-terminal: what a robot finds where its lidar should be.
#pragma once

#include <cstdint>
#include <filesystem>
#include <utility>

#include "host/simulator/pseudo_terminal.h"
#include "host/simulator/rplidar_emulator.h"

namespace ivfm::host {

class RplidarTerminal {
 public:
  // See PseudoTerminal for `link`. The motor follows the scan requests: DTR cannot cross.
  explicit RplidarTerminal(std::filesystem::path link, RplidarEmulatorConfig config = {})
      : terminal_(std::move(link)), emulator_(without_dtr(config)) {}

  // Hears what the robot asked and sends what is due by `now_us`. Every 10 ms or so.
  void step(TimeUs now_us) {
    const auto requests = terminal_.read();
    if (!requests.empty()) emulator_.receive(requests, now_us);
    const auto bytes = emulator_.transmit(now_us);
    lost_bytes_ += bytes.size() - terminal_.write(bytes);
  }

  RplidarEmulator& emulator() { return emulator_; }
  PseudoTerminal& terminal() { return terminal_; }
  // Sent while the far end did not read.
  std::uint64_t lost_bytes() const { return lost_bytes_; }

 private:
  static RplidarEmulatorConfig without_dtr(RplidarEmulatorConfig config) {
    config.motor_by_dtr = false;
    return config;
  }

  PseudoTerminal terminal_;
  RplidarEmulator emulator_;
  std::uint64_t lost_bytes_ = 0;
};

}  // namespace ivfm::host

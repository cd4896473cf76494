// CAN logs as candump writes them (`candump -L`, `-l`): read line by line.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

namespace ivfm::host {

struct CanLogFrame {
  double time_s = 0;  // as in the file
  std::string bus;
  std::uint32_t id = 0;
  bool extended = false, remote = false;
  std::uint8_t size = 0;
  std::array<std::uint8_t, 8> data{};
};

// A line such as "(1436509052.249713) can0 123#AABB"; nothing when it is none, or CAN FD.
std::optional<CanLogFrame> parse_candump(std::string_view line);

struct CanLogCounters {
  std::uint64_t frames = 0;
  std::uint64_t malformed = 0;  // lines that are no frames; empty lines do not count
  std::uint64_t bytes = 0;
};

// Calls `take` for every frame, and `progress` now and then with the bytes that were read. Throws
// std::runtime_error with one sentence when the file cannot be read or has no frame.
CanLogCounters read_can_log(const std::filesystem::path& file,
                            const std::function<void(const CanLogFrame&)>& take,
                            const std::function<void(std::uint64_t)>& progress = {});

}  // namespace ivfm::host

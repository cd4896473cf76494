// Compile-time sizes of the agent for each class of target; everything else is run-time config.
#pragma once

#include <cstddef>
#include <cstdint>

namespace ivfm {

// The paper's arenas: up to 4.2 m with a margin, in cells of 1/64 m.
struct PaperProfile {
  static constexpr const char* kName = "paper";
  static constexpr std::int32_t kCellUm = 15'625;
  static constexpr std::int32_t kWindowCells = 320;
  static constexpr std::size_t kBucketCapacity = 1024;
  static constexpr std::size_t kSurfaceCells = 4096;  // with a known place of their surface
};

// A TurtleBot-class robot on Linux: a 76.8 m window that rolls with it.
struct RobotProfile {
  static constexpr const char* kName = "robot";
  static constexpr std::int32_t kCellUm = 50'000;
  static constexpr std::int32_t kWindowCells = 1536;
  static constexpr std::size_t kBucketCapacity = 8192;
  static constexpr std::size_t kSurfaceCells = 32768;  // with a known place of their surface
};

// A Cortex-M7 with 320 KiB of RAM: a 6.4 m window that rolls with it.
struct McuProfile {
  static constexpr const char* kName = "mcu";
  static constexpr std::int32_t kCellUm = 50'000;
  static constexpr std::int32_t kWindowCells = 128;
  static constexpr std::size_t kBucketCapacity = 128;
  static constexpr std::size_t kSurfaceCells = 512;  // with a known place of their surface
};

}  // namespace ivfm

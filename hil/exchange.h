// What the bridge in the emulated machine and the simulator outside hand each other, tick by tick,
// in a piece of shared memory (QEMU's ivshmem-plain device). Both sides are little endian.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "firmware/hal/can_bus.h"

namespace ivfm::hil {

inline constexpr std::size_t kExchangeBytes = std::size_t{1} << 20;  // the device's memory
inline constexpr std::int64_t kTickNs = 5'000'000;                   // of the machine's clock

// Frames of one tick. At 500 kbit/s no more than 53 fit into 5 ms.
struct Frames {
  std::uint32_t count = 0;
  std::array<CanFrame, 256> items{};
};

// One tick: the bridge writes `now_us` and `to_drives` and counts `asked` up. Until the simulator
// has written the rest and set `answered` to the same number, the machine's time stands (nearly)
// still: the bridge reads a register of the device, which takes the emulator long but the machine
// an instruction.
struct Exchange {
  std::atomic<std::uint32_t> asked;
  std::atomic<std::uint32_t> answered;
  std::uint64_t now_us;  // machine's time since the first tick
  Frames to_drives;
  Frames from_drives;
  std::array<char, 1024> command;  // for the machine's shell; empty: none
};
static_assert(sizeof(Exchange) <= kExchangeBytes);
static_assert(std::is_trivially_copyable_v<Frames> && sizeof(CanFrame) == 12);
static_assert(std::atomic<std::uint32_t>::is_always_lock_free);

}  // namespace ivfm::hil

// Which of a sender's sequence numbers were seen: every one is taken once, those far back never.
#pragma once

#include <cstdint>

namespace ivfm {

class ReplayWindow {
 public:
  // True the first time for every number from newest - 64 upwards; 0 is never a number.
  constexpr bool take(std::uint32_t sequence) {
    if (sequence == 0) return false;
    if (sequence > newest_) {
      const std::uint32_t shift = sequence - newest_;
      const std::uint64_t previous = newest_ != 0 && shift <= 64 ? 1ull << (shift - 1) : 0;
      earlier_ = (shift < 64 ? earlier_ << shift : 0) | previous;
      newest_ = sequence;
      return true;
    }
    const std::uint32_t age = newest_ - sequence;
    if (age == 0 || age > 64) return false;
    const std::uint64_t bit = 1ull << (age - 1);
    if ((earlier_ & bit) != 0) return false;
    earlier_ |= bit;
    return true;
  }
  // The newest, and as bit i whether newest - 1 - i was taken.
  constexpr std::uint32_t newest() const { return newest_; }
  constexpr std::uint64_t earlier() const { return earlier_; }

 private:
  std::uint32_t newest_ = 0;
  std::uint64_t earlier_ = 0;
};

}  // namespace ivfm

// Work on several processor threads whose result does not depend on how many there are.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <thread>
#include <vector>

namespace ivfm::host {

// Calls work(i) for count - 1 .. 0, each once, on `threads` (>= 1) threads. Where the last take
// longest (streams of large worlds) no thread is left with one of them at the end.
inline void for_each_index(std::size_t count, int threads,
                           const std::function<void(std::size_t)>& work) {
  std::atomic<std::size_t> taken{0};
  const auto run = [&] {
    for (std::size_t i = taken++; i < count; i = taken++) work(count - 1 - i);
  };
  std::vector<std::jthread> helpers;
  for (int i = 1; i < threads; ++i) helpers.emplace_back(run);
  run();
}

}  // namespace ivfm::host

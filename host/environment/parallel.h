// Work on several processor threads whose result does not depend on how many there are.
#pragma once

#include <atomic>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace ivfm::host {

// Calls work(i) for count - 1 .. 0, each once, on `threads` (>= 1) threads. Where the last take
// longest (streams of large worlds) no thread is left with one of them at the end. What `work`
// throws first is thrown here, once the calls that were begun are over; no more are begun then.
inline void for_each_index(std::size_t count, int threads,
                           const std::function<void(std::size_t)>& work) {
  std::atomic<std::size_t> taken{0};
  std::once_flag failed;
  std::exception_ptr error;
  const auto run = [&] {
    try {
      for (std::size_t i = taken++; i < count; i = taken++) work(count - 1 - i);
    } catch (...) {
      taken = count;
      std::call_once(failed, [&] { error = std::current_exception(); });
    }
  };
  {
    std::vector<std::jthread> helpers;
    for (int i = 1; i < threads; ++i) helpers.emplace_back(run);
    run();
  }
  if (error) std::rethrow_exception(error);
}

}  // namespace ivfm::host

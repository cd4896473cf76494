#include "host/environment/parallel.h"

#include <gtest/gtest.h>

#include <stdexcept>
#include <vector>

namespace ivfm::host {
namespace {

TEST(ForEachIndex, CallsForEachOnce) {
  for (const int threads : {1, 4}) {
    std::vector<int> calls(100);
    for_each_index(calls.size(), threads, [&](std::size_t i) { ++calls[i]; });
    EXPECT_EQ(calls, std::vector<int>(100, 1));
  }
}

TEST(ForEachIndex, ThrowsWhatTheWorkThrowsOnWhateverThread) {
  const auto fail = [](std::size_t) { throw std::invalid_argument("no such world"); };
  for (const int threads : {1, 4}) {
    EXPECT_THROW(for_each_index(100, threads, fail), std::invalid_argument);
  }
}

}  // namespace
}  // namespace ivfm::host

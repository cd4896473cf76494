#include "tests/support/heap_counter.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

namespace ivfm::test {
namespace {

TEST(HeapCounter, SeesEveryNewBetweenItsMarks) {
  HeapCounter::start();
  const auto number = std::make_unique<int>(1);
  std::vector<int> numbers(100);
  EXPECT_EQ(HeapCounter::stop(), 2u);
  const auto after = std::make_unique<int>(2);
  EXPECT_EQ(HeapCounter::stop(), 2u);
}

TEST(HeapCounter, SeesNothingWhereThereIsNothing) {
  int sum = 0;
  HeapCounter::start();
  for (int i = 0; i < 100; ++i) sum += i;
  EXPECT_EQ(HeapCounter::stop(), 0u);
  EXPECT_EQ(sum, 4950);
}

TEST(HeapCounter, LeavesOutWhatHappensInAPause) {
  HeapCounter::start();
  {
    HeapCounterPause pause;
    std::string text(1000, 'x');
    EXPECT_EQ(text.size(), 1000u);
  }
  EXPECT_EQ(HeapCounter::stop(), 0u);
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST(HeapCounter, SeesMallocOfOtherLibraries) {
  HeapCounter::start();
  char* copy = ::strdup("copied by the C library");
  EXPECT_EQ(HeapCounter::stop(), 1u);
  std::free(copy);
}
#endif

}  // namespace
}  // namespace ivfm::test

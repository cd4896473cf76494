// Counts heap allocations of this thread between two marks, to prove that code makes none.
#pragma once

#include <cstddef>

namespace ivfm::test {

// Link tests/support's ivfm_heap_counter into a test program and every operator new, malloc,
// calloc, realloc and aligned_alloc of the program counts, those in libraries too. Under the
// sanitizers, which bring their own malloc, only operator new counts.
class HeapCounter {
 public:
  static void start();
  // Allocations since start(), without those inside a HeapCounterPause.
  static std::size_t stop();
};

// While one is alive allocations do not count: for fakes that stand in for hardware.
class HeapCounterPause {
 public:
  HeapCounterPause();
  ~HeapCounterPause();
  HeapCounterPause(const HeapCounterPause&) = delete;
  HeapCounterPause& operator=(const HeapCounterPause&) = delete;
};

}  // namespace ivfm::test

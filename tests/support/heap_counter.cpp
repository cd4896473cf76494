#include "tests/support/heap_counter.h"

#include <cstdlib>
#include <new>

namespace ivfm::test {
namespace {

// Plain integers: usable before and while the C++ runtime starts.
thread_local std::size_t allocations = 0;
thread_local int counting = 0;
thread_local int paused = 0;

}  // namespace

// Called by the replaced allocation functions below.
void note_allocation() {
  if (counting > 0 && paused == 0) ++allocations;
}

void HeapCounter::start() {
  allocations = 0;
  counting = 1;
}

std::size_t HeapCounter::stop() {
  counting = 0;
  return allocations;
}

HeapCounterPause::HeapCounterPause() { ++paused; }
HeapCounterPause::~HeapCounterPause() { --paused; }

}  // namespace ivfm::test

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)

void* operator new(std::size_t size) {
  ivfm::test::note_allocation();
  if (void* memory = std::malloc(size > 0 ? size : 1)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

#else

// glibc's own allocator under the names it keeps for replacements like these (glibc manual,
// "Replacing malloc"); operator new calls malloc.
extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* memory, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);

void* malloc(std::size_t size) {
  ivfm::test::note_allocation();
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  ivfm::test::note_allocation();
  return __libc_calloc(count, size);
}
void* realloc(void* memory, std::size_t size) {
  ivfm::test::note_allocation();
  return __libc_realloc(memory, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  ivfm::test::note_allocation();
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** memory, std::size_t alignment, std::size_t size) {
  ivfm::test::note_allocation();
  *memory = __libc_memalign(alignment, size);
  return *memory == nullptr ? 12 : 0;  // ENOMEM
}
}

#endif

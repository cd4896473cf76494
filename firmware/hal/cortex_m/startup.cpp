// From reset to main() on a bare Cortex-M7: vectors, FPU, memory, static objects.
#include <cstddef>
#include <cstdint>

#include "firmware/hal/cortex_m/semihosting.h"
#include "firmware/hal/cortex_m/stack.h"

int main();

// Set by the linker script.
extern "C" {
extern std::uint32_t ivfm_stack_bottom[], ivfm_stack_top[];
extern std::uint32_t ivfm_data_load[], ivfm_data_begin[], ivfm_data_end[];
extern std::uint32_t ivfm_bss_begin[], ivfm_bss_end[];
extern void (*ivfm_init_begin[])(), (*ivfm_init_end[])();
}

namespace ivfm {

namespace {

constexpr std::uint32_t kPaint = 0xdeadbeef;
// "Armv7-M Architecture Reference Manual", B3.2.20: full access to coprocessors 10 and 11, the FPU.
volatile std::uint32_t& cpacr() { return *reinterpret_cast<volatile std::uint32_t*>(0xe000ed88u); }

// Paints what lies below this function's own frame.
[[gnu::noinline]] void paint_stack() {
  std::uint32_t* const here = static_cast<std::uint32_t*>(__builtin_frame_address(0)) - 16;
  for (volatile std::uint32_t* p = ivfm_stack_bottom; p < here; ++p) *p = kPaint;
}

[[noreturn]] void run() {
  std::uint32_t* from = ivfm_data_load;
  for (volatile std::uint32_t* to = ivfm_data_begin; to < ivfm_data_end; ++to) *to = *from++;
  for (volatile std::uint32_t* to = ivfm_bss_begin; to < ivfm_bss_end; ++to) *to = 0;
  paint_stack();
  for (auto init = ivfm_init_begin; init < ivfm_init_end; ++init) (*init)();
  semihosting::exit(main());
}

}  // namespace

std::size_t stack_size() {
  return static_cast<std::size_t>(ivfm_stack_top - ivfm_stack_bottom) * sizeof(std::uint32_t);
}

std::size_t stack_used() {
  const volatile std::uint32_t* first = ivfm_stack_bottom;
  while (first < ivfm_stack_top && *first == kPaint) ++first;
  return static_cast<std::size_t>(ivfm_stack_top - first) * sizeof(std::uint32_t);
}

}  // namespace ivfm

extern "C" {

[[noreturn]] void ivfm_reset() {
  ivfm::cpacr() = ivfm::cpacr() | 0xfu << 20;
  asm volatile("dsb\n isb");
  ivfm::run();
}

[[noreturn]] void ivfm_fault() {
  ivfm::semihosting::print("fault: the processor took an exception\n");
  ivfm::semihosting::exit(70);
}

[[noreturn]] void __cxa_pure_virtual() { ivfm_fault(); }
// libgcc's divisions name this in their unwind tables; nothing here ever unwinds.
void __aeabi_unwind_cpp_pr0() {}

using Vector = void (*)();
// The initial stack pointer, reset, and the fourteen other exceptions of the processor.
[[gnu::section(".vectors"), gnu::used]] const Vector ivfm_vectors[16] = {
    reinterpret_cast<Vector>(ivfm_stack_top),
    ivfm_reset,
    ivfm_fault,
    ivfm_fault,
    ivfm_fault,
    ivfm_fault,
    ivfm_fault,
    ivfm_fault,
    ivfm_fault,
    ivfm_fault,
    ivfm_fault,
    ivfm_fault,
    ivfm_fault,
    ivfm_fault,
    ivfm_fault,
    ivfm_fault,
};
}

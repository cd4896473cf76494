#include "firmware/hal/cortex_m/semihosting.h"

#include <array>
#include <cstring>

namespace ivfm::semihosting {

namespace {

enum Operation : std::uint32_t {
  kOpen = 0x01,
  kWrite0 = 0x04,
  kRead = 0x06,
  kGetCommandLine = 0x15,
  kExitExtended = 0x20,
};
constexpr std::uint32_t kModeReadBinary = 1;                // fopen's "rb"
constexpr std::uint32_t kReasonApplicationExit = 0x20026u;  // ADP_Stopped_ApplicationExit

std::uint32_t call(Operation operation, const void* argument) {
  register std::uint32_t r0 asm("r0") = operation;
  register const void* r1 asm("r1") = argument;
  asm volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}

std::uint32_t word(const void* pointer) {
  return static_cast<std::uint32_t>(reinterpret_cast<std::uintptr_t>(pointer));
}

}  // namespace

std::int32_t open_for_reading(const char* path) {
  const std::array<std::uint32_t, 3> block = {word(path), kModeReadBinary, std::strlen(path)};
  return static_cast<std::int32_t>(call(kOpen, block.data()));
}

std::size_t read(std::int32_t file, std::span<std::uint8_t> out) {
  const std::array<std::uint32_t, 3> block = {static_cast<std::uint32_t>(file), word(out.data()),
                                              out.size()};
  const std::uint32_t missing = call(kRead, block.data());
  return missing > out.size() ? 0 : out.size() - missing;
}

void print(const char* text) { call(kWrite0, text); }

void print_unsigned(std::uint64_t value) {
  std::array<char, 21> digits{};
  std::size_t first = digits.size() - 1;
  do {
    digits[--first] = static_cast<char>('0' + value % 10);
    value /= 10;
  } while (value != 0);
  print(digits.data() + first);
}

void print_hex(std::uint64_t value) {
  std::array<char, 17> digits{};
  for (std::size_t i = 0; i < 16; ++i) digits[i] = "0123456789abcdef"[value >> (60 - 4 * i) & 15u];
  print(digits.data());
}

void command_line(std::span<char> buffer) {
  std::array<std::uint32_t, 2> block = {word(buffer.data()), buffer.size()};
  buffer[0] = 0;
  if (call(kGetCommandLine, block.data()) != 0) buffer[0] = 0;
  buffer.back() = 0;
}

void exit(int code) {
  const std::array<std::uint32_t, 2> block = {kReasonApplicationExit,
                                              static_cast<std::uint32_t>(code)};
  while (true) call(kExitExtended, block.data());
}

}  // namespace ivfm::semihosting

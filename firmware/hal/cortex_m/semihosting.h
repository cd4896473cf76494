// The debugger's services for a bare Cortex-M: files, text, exit ("Semihosting for AArch32 and
// AArch64", Arm document 100863).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace ivfm::semihosting {

// Opens a file of the debugger's machine for reading; negative when there is none.
std::int32_t open_for_reading(const char* path);
// Reads up to `out.size()` bytes; returns how many came.
std::size_t read(std::int32_t file, std::span<std::uint8_t> out);
void print(const char* text);
void print_unsigned(std::uint64_t value);
void print_hex(std::uint64_t value);  // 16 digits
// The command line; empty when there is none. Written into `buffer`, always ends with 0.
void command_line(std::span<char> buffer);
[[noreturn]] void exit(int code);

}  // namespace ivfm::semihosting

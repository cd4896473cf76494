// Files with radio keys: a robot's own, or the server's with those of all robots.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>

#include "firmware/hal/linux/sodium_seal.h"

namespace ivfm {

// By robot id.
using RadioKeys = std::map<std::uint16_t, RadioKey>;

// Lines "ID KEY": a number from 1 to 65535 and 64 hexadecimal digits; "#" begins a comment line.
// Throws std::runtime_error with one sentence that names `file_name` and the line.
RadioKeys parse_radio_keys(std::string_view text, const std::string& file_name);

// The text of such a file.
std::string format_radio_keys(const RadioKeys& keys);

// Throws std::runtime_error with one sentence when the file cannot be read, others may read or
// write it, or it has no right content.
RadioKeys read_radio_keys(const std::string& path);

// Writes a file of mode 600; whole or not at all. Throws std::runtime_error with one sentence.
void write_radio_keys(const std::string& path, const RadioKeys& keys);

}  // namespace ivfm

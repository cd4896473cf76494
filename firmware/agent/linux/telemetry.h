// One line a second about what the agent does, for people or as JSON. No heap.
#pragma once

#include <cstddef>
#include <span>

#include "firmware/agent/agent.h"

namespace ivfm {

// Writes a line that ends with '\n' into `out` (512 bytes suffice for people, 1,024 for JSON);
// returns its length, cut off at the buffer's end.
std::size_t format_telemetry_line(const Agent& agent, TimeUs now_us, std::span<char> out);
std::size_t format_telemetry_json(const Agent& agent, TimeUs now_us, std::span<char> out);

}  // namespace ivfm

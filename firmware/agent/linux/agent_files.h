// The files that ivfm-agent reads and writes: the model at start-up, the map at the end.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "firmware/agent/agent.h"

namespace ivfm {

// The whole file. Throws std::runtime_error with one sentence.
std::vector<std::uint8_t> read_model_file(const std::string& path);

// Writes the robot's own layers (shared/wire/FORMAT.md, "Map dump"); the file appears whole or not
// at all. Throws std::runtime_error with one sentence.
void write_map_file(const std::string& path, const Agent& agent, std::uint16_t robot,
                    std::uint32_t epoch);

}  // namespace ivfm

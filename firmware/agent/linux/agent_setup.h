// From the options of ivfm-agent to the configuration of the core.
#pragma once

#include <cstdint>

#include "firmware/agent/agent.h"
#include "firmware/agent/linux/agent_options.h"

namespace ivfm {

// `epoch`: larger at every start of this robot (seconds of wall time). Lengths are rounded to
// micrometres, angles to binary angles.
AgentConfig make_agent_config(const AgentOptions& options, std::int32_t cell_um,
                              std::uint32_t epoch);

}  // namespace ivfm

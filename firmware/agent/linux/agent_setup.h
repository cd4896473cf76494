// From the options of ivfm-agent to the configuration of the core.
#pragma once

#include <cstdint>

#include "firmware/agent/agent.h"
#include "firmware/agent/linux/agent_options.h"

namespace ivfm {

// `epoch`, `boot`: of this start, see MapLinkConfig. Lengths are rounded to micrometres, angles to
// binary angles.
AgentConfig make_agent_config(const AgentOptions& options, std::int32_t cell_um,
                              std::uint32_t epoch, std::uint64_t boot = 1);

}  // namespace ivfm

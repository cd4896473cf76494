// The map server's figures in Prometheus' text format (docs/map_server.md).
#pragma once

#include <cstdint>
#include <string>

#include "host/map_server/map_server.h"
#include "host/map_server/time_histogram.h"

namespace ivfm::host {

// Version 0.0.4 of the format. `now_us`: of the server's clock; `database_bytes`: of its files.
std::string prometheus_text(const MapServer& server, const TimeHistogram& commits, TimeUs now_us,
                            std::uint64_t database_bytes);

}  // namespace ivfm::host

// A run's data in the formats of other tools.
#pragma once

#include <filesystem>

#include "host/log_analysis/run_data.h"

namespace ivfm::host {

// All throw std::runtime_error with one sentence when the database is none, holds no such data, or
// the output cannot be written. `progress` is called with the percentage that is done. They answer
// what of a damaged database could not be read.

// The merged map for ROS map_server: `yaml` and an image beside it.
Warnings export_ros_map(const std::filesystem::path& database, const std::filesystem::path& yaml,
                        const LoadProgress& progress = {});
// Every table but the map's tiles as RFC 4180 files TABLE.csv in `folder`, which is created.
Warnings export_csv(const std::filesystem::path& database, const std::filesystem::path& folder,
                    const LoadProgress& progress = {});
// The map, paths and goals as a drawing: a millimetre a cell, north is up.
Warnings export_svg(const std::filesystem::path& database, const std::filesystem::path& svg,
                    const LoadProgress& progress = {});

}  // namespace ivfm::host

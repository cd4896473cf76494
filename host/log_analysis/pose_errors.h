// How far a run's robots were from where they believed to be, where somebody knew the truth.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "host/map_server/sqlite.h"

namespace ivfm::host {

// Of one robot. Poses are compared with the truth at the moment that they are of.
struct PoseErrors {
  std::vector<std::pair<double, double>> position_m, heading_deg;  // over time in s; both >= 0
  std::size_t poses = 0;
  double rms_m = 0, largest_m = 0, rms_deg = 0, largest_deg = 0;
  // How much later than that moment the poses came, found as the delay at which the headings agree
  // best.
  double delay_s = 0;
};

// Root mean square and largest over several robots' poses.
PoseErrors over_all(const std::map<std::uint16_t, PoseErrors>& robots);

// Of each robot with poses and truth; empty when the database holds no truth. At most `most_points`
// of each curve. Throws DatabaseError.
std::map<std::uint16_t, PoseErrors> load_pose_errors(SqliteConnection& connection,
                                                     std::size_t most_points);

}  // namespace ivfm::host

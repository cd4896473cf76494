#include "firmware/localization/localization.h"

namespace ivfm {

void Localization::reset(const Pose& pose) {
  odometry_.reset(pose);
  history_.clear();
  surfaces_.clear();
  correction_ = {};
  match_ = {};
}

Status Localization::add_wheels(std::int32_t left_counts, std::int32_t right_counts,
                                TimeUs measured_us) {
  const Status status = odometry_.update(left_counts, right_counts, measured_us);
  if (ok(status)) history_.add(measured_us, odometry_.pose());
  return status;
}

Pose Localization::to_map(const Pose& in_odometry) const {
  return {transform(correction_, in_odometry.position.x_um, in_odometry.position.y_um),
          correction_.heading + in_odometry.heading};
}

MatchOutcome Localization::correct(const ExplorationMap& map, const Scan& scan,
                                   TimeUs measured_us) {
  const Pose in_odometry = history_.at(measured_us);
  const Pose predicted = to_map(in_odometry);
  match_ = matcher_.match(map, surfaces_, predicted, scan);
  if (match_.outcome != MatchOutcome::kMatched) {
    ++(match_.outcome == MatchOutcome::kPoorFit ? counters_.poor : counters_.undecided);
    return match_.outcome;
  }
  ++counters_.matched;
  const Pose pose = blend(predicted, match_);
  // T_map_odom = T_map_robot * T_robot_odom.
  correction_ = {{}, pose.heading - in_odometry.heading};
  const Point turned = transform(correction_, in_odometry.position.x_um, in_odometry.position.y_um);
  correction_.position = {pose.position.x_um - turned.x_um, pose.position.y_um - turned.y_um};
  return match_.outcome;
}

}  // namespace ivfm

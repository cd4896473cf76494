// Ways to tell from a drive log where the robot is: odometry, the robot's own localization, and
// MRPT's ICP-SLAM as the yardstick.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "firmware/mapping/exploration_map.h"
#include "host/localization/drive_log.h"

namespace ivfm::host {

class PoseEstimator {
 public:
  virtual ~PoseEstimator() = default;
  virtual void add_wheels(const WheelSample& sample) = 0;
  virtual void add_revolution(const Revolution& revolution) = 0;
  virtual TruePose pose() const = 0;
  // The robot's own map; null where there is none.
  virtual const ExplorationMap* map() const { return nullptr; }
  // Of the map it built: the share of its area that holds obstacles; nothing when it has none.
  virtual std::string remark() const { return {}; }
};

// `odometry`, `matching` (firmware/localization), `matching-mcu` (the same with a microcontroller's
// memory), `truth` (a robot that always knows where it is) or `icp-slam`
// (mrpt::slam::CMetricMapBuilderICP) for a robot that starts like `log`. Throws
// std::invalid_argument for other names.
std::unique_ptr<PoseEstimator> make_estimator(const std::string& name, const DriveLog& log);

// Errors against the truth, every 100 ms of the drive.
struct PoseError {
  double time_s = 0;
  double position_m = 0;
  double heading_deg = 0;
};

struct Assessment {
  std::vector<PoseError> errors;
  double rms_m = 0, max_m = 0;
  double rms_deg = 0, max_deg = 0;
  double cpu_s = 0;  // of this thread, in the estimator
  std::string remark;
};

// Processor time of this thread so far.
double thread_cpu_s();

// Feeds `log` to `estimator` as the robot would have got it.
Assessment assess(const DriveLog& log, PoseEstimator& estimator);

}  // namespace ivfm::host

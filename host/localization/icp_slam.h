// MRPT's ICP-SLAM on drive logs.
#pragma once

#include <memory>

#include "host/localization/estimators.h"

namespace ivfm::host {

// mrpt::slam::CMetricMapBuilderICP with the settings of MRPT's own icp-slam_demo_classic.ini but
// for those that make it better here (docs/localization.md). It is given revolutions corrected by
// odometry for the motion during their sweep, which MRPT itself does not do.
std::unique_ptr<PoseEstimator> make_icp_slam(const DriveLog& log);

}  // namespace ivfm::host

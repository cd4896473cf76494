#include "firmware/localization/localization.h"

#include <algorithm>
#include <cstdlib>

#include "shared/geometry/integer_sqrt.h"

namespace ivfm {

namespace {

constexpr double kRadiansPerUnit = 6.283185307179586 / 65536;
constexpr double kStill = 0.0003;      // metres a revolution that are never known
constexpr double kStillTurn = 0.0005;  // radians
// Doubt, in 16ths of revolutions that have to fit before the map is painted on. What contradicts
// the map adds to it; what suddenly fits less, or fits only farther off than the prediction allows,
// adds less. The robot is lost when it reaches kLostDoubt.
// Where nothing can be judged it wears off slowly: in the open, or before walls that were only ever
// seen from their other side, no revolution will ever fit.
constexpr std::int32_t kContradictionDoubt = 48;
constexpr std::int32_t kMildDoubt = 16;
constexpr std::int32_t kFitCertainty = 16;
constexpr std::int32_t kUnjudgedCertainty = 1;
constexpr std::int32_t kLostDoubt = 192;
constexpr std::int32_t kFoundDoubt = 96;     // who has just found its place may be mistaken
constexpr std::int32_t kLeastEvidence = 20;  // samples to judge by; fewer that fit count for less
// What suddenly fits less: a share so many percent smaller than of late. A robot that drives on
// sees little new from one revolution to the next; one that was carried away sees most things anew
// (docs/localization.md has how much).
constexpr std::int32_t kSuddenlyLess = 25;
constexpr std::int32_t kFitUnit = 256;   // of a percent
constexpr std::int32_t kFitMemory = 16;  // revolutions
// Odometry that errs more than it should: a match this far from the prediction, in squared standard
// deviations of three numbers, is a surprise. Each makes its variances larger, each match without
// one smaller again.
constexpr double kSurprise = 6;
constexpr double kLeastSpread = 0.3;  // of the prediction's variance, where the scan says nothing
constexpr double kMistrustGrowth = 4;
constexpr double kMistrustDecay = 15.0 / 16;
constexpr double kMostMistrust = 1024;
// A prediction that contradicts the map is less sure than it says: its covariance grows.
constexpr double kContradictionGrowth = 4;
constexpr Symmetric3 kStartCovariance{1e-6, 0, 0, 1e-6, 0, 1e-6};
constexpr Symmetric3 kAlignedCovariance{4e-4, 0, 0, 4e-4, 0, 1e-4};  // 2 cm, 0.6 degrees

}  // namespace

void Localization::reset(const Pose& pose) {
  odometry_.reset(pose);
  history_.clear();
  surfaces_.clear();
  correction_ = {};
  match_ = {};
  matched_ = pose;
  doubt_ = 0;
  lost_ = has_matched_ = false;
  covariance_ = kStartCovariance;
  mistrust_ = 1;
}

void Localization::re_express(const Pose& moved) {
  correction_ = compose(moved, correction_);
  surfaces_.clear();
  covariance_ = kAlignedCovariance;
  has_matched_ = false;
}

Status Localization::add_wheels(std::int32_t left_counts, std::int32_t right_counts,
                                TimeUs measured_us) {
  const Status status = odometry_.update(left_counts, right_counts, measured_us);
  if (ok(status)) history_.add(measured_us, odometry_.pose());
  return status;
}

void Localization::deskew(const Scan& scan, TimeUs start_us, TimeUs end_us, Scan& out) {
  ivfm::deskew(scan, start_us, end_us, history_, out);
  const BinaryAngle turn = history_.at(end_us).heading - history_.at(start_us).heading;
  turned_ = static_cast<std::uint16_t>(std::abs(int{turn.signed_raw()}));
}

Pose Localization::to_map(const Pose& in_odometry) const {
  return compose(correction_, in_odometry);
}

// Carries the covariance on to where the odometry says the robot has moved.
void Localization::predict(const Pose& in_odometry) {
  const Pose before = to_map(matched_), now = to_map(in_odometry);
  const double dx = (now.position.x_um - before.position.x_um) * 1e-6;
  const double dy = (now.position.y_um - before.position.y_um) * 1e-6;
  const double turn = (now.heading - before.heading).signed_raw() * kRadiansPerUnit;
  const double metres = integer_sqrt(static_cast<std::uint64_t>(
                            squared_distance_um2(now.position, before.position))) *
                        1e-6;
  // F P F^T with F the derivative of the motion, which turns with the heading.
  Symmetric3& p = covariance_;
  p = {p.xx - 2 * dy * p.xt + dy * dy * p.tt,
       p.xy + dx * p.xt - dy * p.yt - dx * dy * p.tt,
       p.xt - dy * p.tt,
       p.yy + 2 * dx * p.yt + dx * dx * p.tt,
       p.yt + dx * p.tt,
       p.tt};
  const double slip =
      config_.slip_m_per_sqrt_m * config_.slip_m_per_sqrt_m * metres + kStill * kStill;
  const double drift = config_.drift_rad_per_sqrt_m * config_.drift_rad_per_sqrt_m * metres +
                       config_.turn_error * config_.turn_error * turn * turn +
                       kStillTurn * kStillTurn;
  p = p + Symmetric3{slip * mistrust_, 0, 0, slip * mistrust_, 0, drift * mistrust_};
  matched_ = in_odometry;
}

MatchOutcome Localization::correct(const ExplorationMap& map, const Scan& scan,
                                   TimeUs measured_us) {
  const Pose in_odometry = history_.at(measured_us);
  predict(in_odometry);
  if (lost_) {
    relocate(map, scan);
    return MatchOutcome::kPoorFit;
  }
  const Pose predicted = to_map(in_odometry);
  match_ = matcher_.match(map, surfaces_, predicted, covariance_, scan);
  // Who has not matched once since the start knows nothing but where it was told to be: a map from
  // before a restart that does not fit is no reason to stand still for good.
  if (match_.outcome == MatchOutcome::kPoorFit && !has_matched_) {
    match_.outcome = MatchOutcome::kUnknownPlace;
  }
  judge(match_.outcome, map);
  if (match_.outcome == MatchOutcome::kMatched) {
    if (!has_matched_) usual_fit_ = share_that_fits();
    has_matched_ = true;
    judge_odometry(difference(match_.pose, predicted));
    covariance_ = match_.covariance;
    put_at(match_.pose, in_odometry);
  }
  return match_.outcome;
}

// How far the match has moved from the prediction, against how far it should: where the scan says
// little the prediction holds it, and a small move is a large surprise.
void Localization::judge_odometry(const Vector3& off) {
  const Symmetric3 spread = covariance_ * (1 + kLeastSpread) + match_.covariance * -1;
  const double squares = dot(off, spread.inverse() * off);
  mistrust_ = squares > kSurprise ? std::min(mistrust_ * kMistrustGrowth, kMostMistrust)
                                  : std::max(mistrust_ * kMistrustDecay, 1.0);
}

void Localization::judge(MatchOutcome outcome, const ExplorationMap& map) {
  switch (outcome) {
    case MatchOutcome::kMatched: ++counters_.matched; break;
    case MatchOutcome::kPoorFit:
      ++counters_.poor;
      covariance_ = covariance_ * kContradictionGrowth;
      break;
    default: ++counters_.undecided;
  }
  weigh_doubt(outcome);
  if (doubt_ < kLostDoubt) return;
  lost_ = true;
  ++counters_.lost;
  relocation_.begin(map);
}

// To a lidar that does not see all around each turn shows something new: only what is known counts.
std::int32_t Localization::could_fit() const {
  return config_.sees_all_around ? match_.could_fit() : match_.judged;
}

std::int32_t Localization::share_that_fits() const {
  return kFitUnit * 100 * match_.fitting / std::max<std::int32_t>(1, could_fit());
}

void Localization::weigh_doubt(MatchOutcome outcome) {
  const auto change = [this](std::int32_t by) {
    doubt_ = static_cast<std::uint8_t>(std::max<std::int32_t>(0, doubt_ + by));
  };
  if (outcome == MatchOutcome::kPoorFit) {
    change(match_.explained_elsewhere ? kMildDoubt : kContradictionDoubt);
    return;
  }
  if (has_matched_ && could_fit() >= kLeastEvidence) {
    const std::int32_t fit = share_that_fits();
    if (fit < usual_fit_ - kFitUnit * kSuddenlyLess) return change(kMildDoubt);
    usual_fit_ += (fit - usual_fit_) / kFitMemory;
  }
  const std::int32_t evidence = outcome == MatchOutcome::kMatched ? match_.fitting : 0;
  change(-std::clamp<std::int32_t>(kFitCertainty * evidence / kLeastEvidence, kUnjudgedCertainty,
                                   kFitCertainty));
}

void Localization::relocate(const ExplorationMap& map, const Scan& scan) {
  const Relocation::Result result =
      relocation_.step(map, surfaces_, matcher_, scan, to_map(matched_));
  if (result == Relocation::Result::kNotFound) ++counters_.searches;
  if (result != Relocation::Result::kFound) return;
  lost_ = false;
  doubt_ = kFoundDoubt;
  match_ = relocation_.match();
  usual_fit_ = share_that_fits();
  covariance_ = match_.covariance;
  put_at(match_.pose, matched_);
}

// Makes `in_odometry` mean `pose`: T_map_odom = T_map_robot * T_robot_odom.
void Localization::put_at(const Pose& pose, const Pose& in_odometry) {
  correction_ = {{}, pose.heading - in_odometry.heading};
  const Point turned = transform(correction_, in_odometry.position.x_um, in_odometry.position.y_um);
  correction_.position = {pose.position.x_um - turned.x_um, pose.position.y_um - turned.y_um};
}

}  // namespace ivfm

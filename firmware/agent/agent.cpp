#include "firmware/agent/agent.h"

#include <algorithm>

namespace ivfm {

namespace {

// An age for the supervisor, saturating.
std::uint32_t age_us(TimeUs now_us, TimeUs then_us) {
  const TimeUs age = now_us - std::min(now_us, then_us);
  return static_cast<std::uint32_t>(std::min<TimeUs>(age, kNeverUs - 1));
}

// The map's geometry is the explorer's, whatever the configuration says.
MapLinkConfig link_config(const AgentConfig& config, const Explorer& explorer) {
  MapLinkConfig link = config.link;
  link.cell_um = explorer.map().frame().cell_um();
  link.apart = config.unknown_start;
  link.rough = config.rough_start && !config.unknown_start;
  return link;
}

// Corrections of the map frame by two scans from places farther apart than this are told by two
// views; they agree when they differ by no more than an alignment errs.
constexpr std::int64_t kOtherPlaceUm = 500'000;
constexpr std::int64_t kAgreeUm = 120'000;
constexpr std::int32_t kAgreeTurn = 364;  // 2 degrees

// Where another robot was longer ago says little about who looks at what next.
constexpr TimeUs kTeammateAgeUs = 5'000'000;

}  // namespace

Agent::Agent(const AgentConfig& config, const AgentPorts& ports, Explorer& explorer,
             std::span<SurfaceMap::Entry> surfaces)
    : config_(config),
      explorer_(explorer),
      clock_(ports.clock),
      lidar_(ports.lidar, config.lidar),
      wheels_(config.wheels, ports.can),
      localization_(config.localization, surfaces, config.wheels.geometry,
                    config.wheels.max_wheel_um_s * 2),
      follower_(config.follower),
      supervisor_(config.supervisor),
      link_(explorer.map(), ports.radio, link_config(config, explorer), ports.seal) {
  localization_.reset(config.start);
  if (config.unknown_start) {
    start_pose_ = StartPose::kApart;
  } else if (config.rough_start) {
    start_pose_ = StartPose::kSearching;
    alignment_.begin(config.start);
  }
  pose_ = config.start;
  explorer_.start(config.start);
  link_.clip(explorer_.map().frame().window());
  if (config.autostart) (void)supervisor_.request(RobotEvent::kExplore);  // remembered in kBoot
}

void Agent::step(TimeUs now_us) {
  if (started_us_ == 0) started_us_ = now_us;
  sense_wheels(now_us);
  sense_surroundings(now_us);
  look_for_target();
  exchange_maps(now_us);
  obey_commands();
  choose_goal(now_us);
  drive(now_us);
}

// CAN encoders -> odometry -> pose.
void Agent::sense_wheels(TimeUs now_us) {
  wheels_.step(now_us);
  const WheelDrive::Positions& positions = wheels_.positions();
  if (!positions.valid || positions.measured_us == positions_us_) return;
  positions_us_ = positions.measured_us;
  (void)localization_.add_wheels(positions.left, positions.right, positions.measured_us);
  pose_ = localization_.pose();
}

// RPLIDAR bytes -> scan -> corrected pose -> occupancy and visits.
void Agent::sense_surroundings(TimeUs now_us) {
  lidar_.start(now_us);
  (void)lidar_.step(now_us);  // a failing port shows as a stale lidar
  const Scan* scan = lidar_.take_scan();
  if (scan == nullptr || !localization_.ready()) return;
  const LocalizationConfig& localization = config_.localization;
  const TimeUs delay_us =
      localization.matching ? std::min(localization.scan_delay_us, lidar_.scan_start_us()) : 0;
  const TimeUs measured_us = lidar_.scan_end_us() - delay_us;
  scan_us_ = lidar_.scan_end_us();
  localization_.deskew(*scan, lidar_.scan_start_us() - delay_us, measured_us, scan_);
  if (start_pose_ == StartPose::kSearching) {
    align_start();
    return;
  }
  if (!localization_.lost()) {
    mark_robots(config_.others, link_.peers(), localization_.pose_at(measured_us), measured_us,
                scan_);
  }
  if (localization.matching) {
    (void)localization_.correct(explorer_.map(), scan_, measured_us);
    pose_ = localization_.pose();
  }
  pose_at_scan_ = localization_.pose_at(measured_us);
  has_scan_ = new_scan_ = true;
  if (!localization_.trusted()) return;  // paint nothing at a place that is in doubt
  const TimeUs before = clock_.now_us();
  const ViewStatistics seen = explorer_.fuse(pose_at_scan_, scan_, view_is_due());
  fusion_time_us_ = static_cast<std::uint32_t>(clock_.now_us() - before);
  if (localization.matching) localization_.learn(explorer_.map(), scan_, measured_us);
  progress_.newly_seen_cells += seen.newly_seen_cells;
  ++progress_.scans_fused;
  if (start_pose_ == StartPose::kNotFound) align_later();
}

bool Agent::view_is_due() {
  const std::uint64_t travelled_um = odometry().travelled_um();
  const bool on_the_way = acting_ && follower_.active();
  if (on_the_way && static_cast<std::int64_t>(travelled_um - viewed_um_) < config_.view_spacing_um)
    return false;
  viewed_um_ = travelled_um;
  return true;
}

// Corrects a rough start pose before anything is painted or told in a wrong frame.
void Agent::align_start() {
  has_scan_ = true;
  const ExplorationMap& map = explorer_.map();
  const auto samples = localization_.surfaces_in(scan_, map.frame().cell_um());
  switch (alignment_.step(map, samples, config_.start)) {
    case StartAlignment::Result::kSearching: break;
    case StartAlignment::Result::kNotFound:
      start_pose_ = StartPose::kNotFound;
      alignment_.search_far();
      break;
    case StartAlignment::Result::kFound:
      start_pose_ = StartPose::kCorrected;
      pose_ = compose(alignment_.correction(), config_.start);
      localization_.reset(pose_);
      explorer_.correct_start(pose_);
      link_.end_rough();
      break;
  }
  pose_at_scan_ = pose_;
}

// The walls of others may come into view only later. A correction counts when two places tell it.
void Agent::align_later() {
  const ExplorationMap& map = explorer_.map();
  const auto samples = localization_.surfaces_in(scan_, map.frame().cell_um());
  if (alignment_.step(map, samples, pose_at_scan_) != StartAlignment::Result::kFound) return;
  const Pose correction = alignment_.correction();
  const Pose& place = alignment_.seen_from();
  const bool agrees =
      likely_correction_ && is_near(compose(*likely_correction_, place), compose(correction, place),
                                    kAgreeUm, kAgreeTurn);
  const bool elsewhere =
      squared_distance_um2(likely_seen_from_, place.position) > kOtherPlaceUm * kOtherPlaceUm;
  if (agrees && !elsewhere) return;
  likely_correction_ = correction;
  likely_seen_from_ = place.position;
  if (agrees) move_frame(correction);
}

// All that this robot has seen and told is expressed in the others' frame.
void Agent::move_frame(const Pose& moved) {
  const bool alone = start_pose_ == StartPose::kApart;
  start_pose_ = StartPose::kCorrected;
  localization_.re_express(moved);
  explorer_.re_express(moved, alone);
  supervisor_.re_express(moved);
  pose_ = localization_.pose();
  pose_at_scan_ = compose(moved, pose_at_scan_);
  follower_.cancel();
  acting_ = false;
  link_.move_frame();
  link_.clip(explorer_.map().frame().window());
  share_map();
}

// Stands in for a camera: a target is found by the robot that has seen its cell.
void Agent::look_for_target() {
  if (!config_.target || found_ || start_pose_ == StartPose::kApart) return;
  const Cell cell = explorer_.map().frame().cell_at(*config_.target);
  std::uint8_t visits = 0;
  const Status read =
      explorer_.map().read_own(Layer::kVisits, {cell.x, cell.y, 1, 1}, {&visits, 1});
  if (!ok(read) || visits == 0) return;
  found_ = true;
  link_.report_found(*config_.target);
  (void)supervisor_.request(RobotEvent::kTargetFound);
}

// Own changes to the server, the others' cells from it.
void Agent::exchange_maps(TimeUs now_us) {
  if (now_us - shared_us_ >= config_.share_period_us) {
    shared_us_ = now_us;
    share_map();
  }
  link_.set_status(status(now_us));
  link_.step(now_us, pose_);
  // A move forgets the surfaces by which a robot in doubt will know its place again: that one
  // waits.
  if (start_pose_ == StartPose::kApart && !localization_.trusted()) return;
  if (const std::optional<Pose> frame = link_.take_frame()) take_frame(*frame);
}

// The server knows how this robot's map frame lies in the team's.
void Agent::take_frame(const Pose& frame) {
  if (start_pose_ == StartPose::kApart) {
    move_frame(frame);
    return;
  }
  start_pose_ = StartPose::kGiven;  // by definition: others go by it
  link_.end_rough();
}

RobotStatus Agent::status(TimeUs now_us) const {
  RobotStatus status;
  status.state = static_cast<std::uint8_t>(supervisor_.state());
  status.fault = static_cast<std::uint8_t>(supervisor_.reasons().bits() & 0xff);
  status.goal = acting_ ? decision_.goal : explorer_.map().frame().cell_at(pose().position);
  status.uptime_ms = static_cast<std::uint32_t>((now_us - std::min(now_us, started_us_)) / 1000);
  status.actions = progress_.actions;
  status.distance_mm = static_cast<std::uint32_t>(odometry().travelled_um() / 1000);
  status.decision_us = decision_time_us_;
  return status;
}

void Agent::share_map() {
  for (const Layer layer : {Layer::kVisits, Layer::kObstacles}) {
    link_.mark_dirty(layer, explorer_.map().take_changes(layer));
  }
}

// What the server asks for; a request that the state does not allow has no effect.
void Agent::obey_commands() {
  const std::optional<CommandCode> command = link_.take_command();
  if (!command) return;
  switch (*command) {
    case CommandCode::kStart:
      (void)supervisor_.request(RobotEvent::kStart);
      (void)supervisor_.request(RobotEvent::kExplore);
      break;
    case CommandCode::kStop: (void)supervisor_.request(RobotEvent::kStop); break;
    case CommandCode::kReturn: (void)supervisor_.request(RobotEvent::kReturn); break;
    case CommandCode::kFound: (void)supervisor_.request(RobotEvent::kTargetFound); break;
  }
}

// i-VFM state -> Q values -> goal -> path.
void Agent::choose_goal(TimeUs now_us) {
  if (!supervisor_.may_move() && !looks_again(now_us)) {
    follower_.cancel();
    acting_ = false;
    return;
  }
  if (acting_ && !action_is_over(now_us)) return;
  if (!has_scan_) return;
  if (acting_) share_map();
  acting_ = false;
  decided_us_ = now_us;
  decide();
  if (decision_.kind == Decision::Kind::kExplored) {
    follower_.cancel();
    const bool returning = supervisor_.state() == RobotState::kReturning;
    (void)supervisor_.request(returning ? RobotEvent::kHome : RobotEvent::kMapExplored);
    return;
  }
  const bool home = decision_.kind == Decision::Kind::kReturn;
  (void)supervisor_.request(home ? RobotEvent::kReturn : RobotEvent::kExplore);  // or goes on
  begin_action(now_us);
}

// Nothing was left to explore; since then the map may have grown, or who stood in the way has left.
bool Agent::looks_again(TimeUs now_us) const {
  return supervisor_.state() == RobotState::kExplored &&
         now_us - decided_us_ >= config_.look_again_us;
}

void Agent::tell_explorer_of_teammates(TimeUs now_us) {
  static_assert(RobotPlaces::kMost <= Teammates::kMost);
  std::array<Point, Teammates::kMost> positions;
  std::size_t count = 0;
  for (const PeerRobot& peer : link_.peers()) {
    if (now_us - peer.told_us <= kTeammateAgeUs) positions[count++] = peer.position;
  }
  explorer_.set_teammates(std::span(positions).first(count));
}

void Agent::decide() {
  const TimeUs before = clock_.now_us();
  tell_explorer_of_teammates(before);
  decision_ = supervisor_.state() == RobotState::kReturning ? explorer_.select_return(pose_)
                                                            : explorer_.decide(pose_, network_);
  link_.clip(explorer_.map().frame().window());  // the window may have rolled
  decision_time_us_ = static_cast<std::uint32_t>(clock_.now_us() - before);
}

bool Agent::action_is_over(TimeUs now_us) {
  if (stuck_ || held_for_us_ > config_.max_hold_us) {
    stuck_ = false;
    held_for_us_ = 0;
    ++progress_.stuck;
    explorer_.abandon_goal();
    return true;
  }
  if (!follower_.active()) return config_.view_spacing_um == 0 || new_scan_;
  const auto travelled = static_cast<std::int64_t>(odometry().travelled_um() - action_start_um_);
  if (!config_.keeps_goals && travelled >= config_.max_action_travel_um) return true;
  if (!new_scan_) return false;
  new_scan_ = false;
  if (explorer_.goal_is_still_good(pose_, follower_.next_waypoint())) return false;
  return !config_.keeps_goals || !goes_around(now_us);
}

// False: the goal is out of reach now.
bool Agent::goes_around(TimeUs now_us) {
  return ok(explorer_.replan(pose_)) && ok(follower_.start(explorer_.path().points(), now_us));
}

void Agent::begin_action(TimeUs now_us) {
  explorer_.begin_action();
  acting_ = ok(follower_.start(explorer_.path().points(), now_us));
  action_start_um_ = odometry().travelled_um();
  stuck_ = false;
  held_for_us_ = 0;
  ++progress_.actions;
  if (decision_.kind == Decision::Kind::kGlobalGoal) ++progress_.global_actions;
}

// Path -> v, omega -> gate -> wheels -> CAN.
void Agent::drive(TimeUs now_us) {
  const FollowStep wish = follower_.step(pose_, commanded_, now_us);
  stuck_ = stuck_ || wish.status == Status::kTimeout;
  commanded_ = supervisor_.gate(wish.velocity, supervisor_inputs(now_us), now_us);
  const bool held = supervisor_.reasons().has(StopReason::kObstacle);
  held_for_us_ = held ? held_for_us_ + (now_us - driven_us_) : 0;
  driven_us_ = now_us;
  if (supervisor_.reasons().has(StopReason::kInternalError)) {
    wheels_.quick_stop();
    return;
  }
  wheels_.set_velocity(commanded_);
}

SupervisorInputs Agent::supervisor_inputs(TimeUs now_us) const {
  SupervisorInputs inputs;
  if (has_scan_) inputs.lidar_age_us = age_us(now_us, scan_us_);
  if (wheels_.positions().valid) {
    inputs.odometry_age_us = age_us(now_us, wheels_.positions().measured_us);
  }
  inputs.drives_operational = wheels_.enabled(now_us);
  inputs.stop_requested = stop_requested_;
  inputs.lost = localization_.lost() || start_pose_ == StartPose::kSearching;
  inputs.scan = has_scan_ ? &scan_ : nullptr;
  inputs.pose_at_scan = pose_at_scan_;
  inputs.pose = pose_;
  inputs.measured = wheels_.measured_velocity();
  return inputs;
}

}  // namespace ivfm

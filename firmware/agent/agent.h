// The robot's agent: from RPLIDAR bytes and CAN frames to CAN frames, in fixed memory.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "firmware/agent/profile.h"
#include "firmware/hal/can_bus.h"
#include "firmware/hal/clock.h"
#include "firmware/hal/datagram_socket.h"
#include "firmware/hal/serial_port.h"
#include "firmware/lidar/rplidar_driver.h"
#include "firmware/link/map_link.h"
#include "firmware/localization/localization.h"
#include "firmware/localization/robot_mask.h"
#include "firmware/localization/start_alignment.h"
#include "firmware/nn/q_network.h"
#include "firmware/planning/explorer.h"
#include "firmware/supervisor/supervisor.h"
#include "firmware/tracking/path_follower.h"
#include "firmware/wheel_drive/wheel_drive.h"

namespace ivfm {

struct AgentConfig {
  ExplorerConfig explorer;
  RplidarConfig lidar;
  WheelDriveConfig wheels;
  LocalizationConfig localization;
  RobotMaskConfig others;
  FollowerConfig follower;
  SupervisorConfig supervisor;
  MapLinkConfig link;
  Pose start;  // in the map frame, where the robot is switched on
  // `start` may be 0.5 m and 15 degrees wrong: the robot stands until it has found out by what the
  // others have mapped there, or cannot.
  bool rough_start = false;
  // `start` tells nothing: the robot's map frame is its own, and its map stays apart from the
  // team's until the server has found out how they lie to each other.
  bool unknown_start = false;
  bool autostart = true;  // explore as soon as the devices are ready
  // An action ends after this much driving even when its goal is further: the map has changed.
  std::int32_t max_action_travel_um = 1'500'000;
  bool keeps_goals = false;  // or it goes on to its goal, around what is in its way
  // What is seen counts as visited after each so much travel and where the way ends, not while the
  // robot turns (method.md, "Sensor footprint": every 6 % of the local map's width); 0: always.
  std::int32_t view_spacing_um = 0;
  TimeUs max_hold_us = 1'000'000;      // held back by an obstacle for longer: another goal
  TimeUs share_period_us = 2'000'000;  // changes of the map go to the link at least so often
  TimeUs look_again_us = 2'000'000;    // a robot that sees nothing left to explore looks again
  std::optional<Point> target;         // found, and the search over, once its cell was seen
};

struct AgentPorts {
  SerialPort& lidar;
  CanBus& can;
  DatagramSocket& radio;
  Clock& clock;                           // only to measure how long decisions take
  const DatagramSeal& seal = kPlainSeal;  // of this robot's radio
};

// Counters and states for people; everything a part counts can be asked from that part.
struct AgentProgress {
  std::uint32_t actions = 0;         // decisions that led to a move
  std::uint32_t global_actions = 0;  // of these, goals outside the local map
  std::uint32_t stuck = 0;           // moves given up for lack of progress
  std::uint32_t scans_fused = 0;
  std::uint64_t newly_seen_cells = 0;  // by this robot, first of all robots as far as it knew
};

// What a robot knows of where it started.
enum class StartPose : std::uint8_t { kGiven, kSearching, kCorrected, kNotFound, kApart };

class Agent {
 public:
  // `explorer`, `surfaces` (see SurfaceMap) and the ports must outlive the agent.
  Agent(const AgentConfig& config, const AgentPorts& ports, Explorer& explorer,
        std::span<SurfaceMap::Entry> surfaces);

  // Loads the policy; `model` must outlive the agent. Without one the agent explores the nearest
  // frontier. A model for another state than i-VFM and path is refused.
  ModelStatus load_model(std::span<const std::uint8_t> model) {
    return network_.load_for_robot(model);
  }

  // Everything that is due at `now_us`. Call every 10 ms or so, also when nothing happens.
  void step(TimeUs now_us);

  // A person's or the operating system's wish; the server's come over the link.
  void request_stop() { stop_requested_ = true; }
  // Puts all changes of the map on the link, as at the end of an action.
  void share_map();
  // For the end of a run: send what is left without waiting; true once the server has all of it.
  void flush_map() {
    share_map();
    link_.flush();
  }
  bool map_is_shared() const { return link_.all_acknowledged(); }

  const Pose& pose() const { return pose_; }
  StartPose start_pose() const { return start_pose_; }
  RobotState state() const { return supervisor_.state(); }
  const Decision& decision() const { return decision_; }
  const AgentProgress& progress() const { return progress_; }
  const RplidarDriver& lidar() const { return lidar_; }
  const WheelDrive& wheels() const { return wheels_; }
  const Odometry& odometry() const { return localization_.odometry(); }
  const Localization& localization() const { return localization_; }
  const Supervisor& supervisor() const { return supervisor_; }
  const MapLink& link() const { return link_; }
  const Explorer& explorer() const { return explorer_; }
  // The last revolution, corrected for motion.
  const Scan& last_scan() const { return scan_; }
  const Velocity& commanded() const { return commanded_; }
  // How long the last decision, and the fusion of the last revolution, took.
  std::uint32_t decision_time_us() const { return decision_time_us_; }
  std::uint32_t fusion_time_us() const { return fusion_time_us_; }

 private:
  void sense_wheels(TimeUs now_us);
  void sense_surroundings(TimeUs now_us);
  void align_start();
  void align_later();
  void move_frame(const Pose& moved);
  void take_frame(const Pose& frame);
  void look_for_target();
  void exchange_maps(TimeUs now_us);
  void obey_commands();
  void choose_goal(TimeUs now_us);
  bool looks_again(TimeUs now_us) const;
  void drive(TimeUs now_us);

  void tell_explorer_of_teammates(TimeUs now_us);
  void decide();
  bool action_is_over(TimeUs now_us);
  bool goes_around(TimeUs now_us);
  bool view_is_due();
  void begin_action(TimeUs now_us);
  RobotStatus status(TimeUs now_us) const;
  SupervisorInputs supervisor_inputs(TimeUs now_us) const;

  AgentConfig config_;
  Explorer& explorer_;
  Clock& clock_;
  RplidarDriver lidar_;
  WheelDrive wheels_;
  Localization localization_;
  QNetwork network_;
  StartAlignment alignment_;
  StartPose start_pose_ = StartPose::kGiven;
  std::optional<Pose> likely_correction_;  // T_new_old of the map frame, seen from one place
  Point likely_seen_from_;
  PathFollower follower_;
  Supervisor supervisor_;
  MapLink link_;

  Pose pose_;    // in the map, as of the last measurement
  Scan scan_{};  // the last revolution, corrected for motion
  bool has_scan_ = false;
  TimeUs scan_us_ = 0;
  Pose pose_at_scan_{};
  bool new_scan_ = false;
  TimeUs positions_us_ = 0;

  Decision decision_{};
  bool acting_ = false;
  std::uint64_t action_start_um_ = 0;
  std::uint64_t viewed_um_ = 0;  // travelled when what was seen last counted as visited
  bool stuck_ = false;
  TimeUs decided_us_ = 0;
  TimeUs held_for_us_ = 0;  // by an obstacle, without a break
  TimeUs driven_us_ = 0;
  Velocity commanded_{};
  TimeUs shared_us_ = 0;
  TimeUs started_us_ = 0;
  std::uint32_t decision_time_us_ = 0, fusion_time_us_ = 0;
  bool stop_requested_ = false;
  bool found_ = false;
  AgentProgress progress_{};
};

// An explorer that is constructed before the agent that uses it.
template <typename Profile>
struct ExplorerMember {
  explicit ExplorerMember(const ExplorerConfig& config) : explorer_memory(config) {}
  ExplorerFor<Profile> explorer_memory;
};

// The agent with all its memory. Its size is a constant of the profile.
template <typename Profile>
class AgentFor : private ExplorerMember<Profile>,
                 private SurfaceStorage<Profile::kSurfaceCells>,
                 public Agent {
 public:
  AgentFor(const AgentConfig& config, const AgentPorts& ports)
      : ExplorerMember<Profile>(config.explorer),
        Agent(config, ports, ExplorerMember<Profile>::explorer_memory,
              SurfaceStorage<Profile::kSurfaceCells>::surface_entries) {}
  AgentFor(const AgentFor&) = delete;
  AgentFor& operator=(const AgentFor&) = delete;
};

}  // namespace ivfm

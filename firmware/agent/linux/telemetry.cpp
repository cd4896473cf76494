#include "firmware/agent/linux/telemetry.h"

#include <algorithm>
#include <cinttypes>
#include <cstdio>

namespace ivfm {

namespace {

std::size_t written(int length, std::span<char> out) {
  return std::min(static_cast<std::size_t>(std::max(length, 0)), out.size() - 1);
}

const char* to_string(StartPose start) {
  constexpr const char* kNames[] = {"given", "searching", "corrected", "not found", "apart"};
  return kNames[static_cast<std::size_t>(start)];
}

double metres(std::int64_t um) { return static_cast<double>(um) / 1e6; }

}  // namespace

std::size_t format_telemetry_line(const Agent& agent, TimeUs now_us, std::span<char> out) {
  const Pose& pose = agent.pose();
  const MapLinkCounters& link = agent.link().counters();
  const RplidarDriver::Counters lidar = agent.lidar().counters();
  const int length = std::snprintf(
      out.data(), out.size(),
      "%7.1f s  %-9s at %+.2f %+.2f m %+4.0f deg  driven %.1f m  actions %" PRIu32
      "  scans %" PRIu32 " (resync %" PRIu32 ", reconnect %" PRIu32 ")  can %" PRIu32
      " in, %" PRIu32 " failed  radio %" PRIu64 " B out, %" PRIu64 " B in, %" PRIu32
      " again  decision %.1f ms\n",
      static_cast<double>(now_us) / 1e6, to_string(agent.state()), metres(pose.position.x_um),
      metres(pose.position.y_um), pose.heading.degrees(),
      metres(static_cast<std::int64_t>(agent.odometry().travelled_um())), agent.progress().actions,
      lidar.scans, lidar.resyncs, lidar.reconnects, agent.wheels().counters().frames_received,
      agent.wheels().counters().send_failures, link.bytes_sent, link.bytes_received,
      link.retransmissions, static_cast<double>(agent.decision_time_us()) / 1000.0);
  return written(length, out);
}

std::size_t format_telemetry_json(const Agent& agent, TimeUs now_us, std::span<char> out) {
  const Pose& pose = agent.pose();
  const MapLinkCounters& link = agent.link().counters();
  const RplidarDriver::Counters lidar = agent.lidar().counters();
  const WheelDrive::Counters& can = agent.wheels().counters();
  const LocalizationCounters& places = agent.localization().counters();
  const int length = std::snprintf(
      out.data(), out.size(),
      "{\"time_us\":%" PRIu64
      ",\"state\":\"%s\",\"stop_reasons\":%u,\"x_m\":%.3f,\"y_m\":%.3f,"
      "\"heading_deg\":%.1f,\"travelled_m\":%.3f,\"actions\":%" PRIu32
      ",\"global_actions\":%" PRIu32 ",\"stuck\":%" PRIu32 ",\"newly_seen_cells\":%" PRIu64
      ",\"decision_us\":%" PRIu32 ",\"fusion_us\":%" PRIu32 ",\"lidar\":{\"bytes\":%" PRIu64
      ",\"scans\":%" PRIu32 ",\"resyncs\":%" PRIu32 ",\"dropped_frames\":%" PRIu32
      ",\"dropped_samples\":%" PRIu32 ",\"reconnects\":%" PRIu32
      "},\"can\":{\"frames_received\":%" PRIu32 ",\"frames_ignored\":%" PRIu32
      ",\"send_failures\":%" PRIu32 ",\"bus_failures\":%" PRIu32 ",\"common_stops\":%" PRIu32
      "},\"radio\":{\"bytes_sent\":%" PRIu64 ",\"bytes_received\":%" PRIu64
      ",\"datagrams_sent\":%" PRIu64 ",\"datagrams_received\":%" PRIu64
      ",\"retransmissions\":%" PRIu32 ",\"dropped\":%" PRIu32 "},\"odometry_jumps\":%" PRIu32
      ",\"localization\":{\"matched\":%" PRIu32 ",\"undecided\":%" PRIu32 ",\"poor\":%" PRIu32
      ",\"lost\":%" PRIu32 ",\"searches\":%" PRIu32 ",\"start\":\"%s\"}}\n",
      now_us, to_string(agent.state()), unsigned{agent.supervisor().reasons().bits()},
      metres(pose.position.x_um), metres(pose.position.y_um), pose.heading.degrees(),
      metres(static_cast<std::int64_t>(agent.odometry().travelled_um())), agent.progress().actions,
      agent.progress().global_actions, agent.progress().stuck, agent.progress().newly_seen_cells,
      agent.decision_time_us(), agent.fusion_time_us(), lidar.bytes, lidar.scans, lidar.resyncs,
      lidar.dropped_frames, lidar.dropped_samples, lidar.reconnects, can.frames_received,
      can.frames_ignored, can.send_failures, can.bus_failures, can.common_stops, link.bytes_sent,
      link.bytes_received, link.datagrams_sent, link.datagrams_received, link.retransmissions,
      link.dropped_malformed + link.dropped_misdirected + link.dropped_refused +
          link.dropped_replayed + link.dropped_stale + link.dropped_cell_size,
      agent.odometry().jumps(), places.matched, places.undecided, places.poor, places.lost,
      places.searches, to_string(agent.start_pose()));
  return written(length, out);
}

}  // namespace ivfm

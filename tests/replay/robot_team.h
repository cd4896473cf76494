// Simulated robots in one process, with the real map server. Host only.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "host/map_server/map_server.h"
#include "tests/replay/simulated_robot.h"

namespace ivfm::replay {

class RobotTeam final : public host::DatagramSender {
 public:
  // `robots` must outlive the team.
  explicit RobotTeam(std::vector<std::unique_ptr<SimulatedRobot>>& robots);
  RobotTeam(const RobotTeam&) = delete;
  RobotTeam& operator=(const RobotTeam&) = delete;

  // What has been sent arrives, both ways.
  void exchange(TimeUs now_us);
  // From now on messages of this kind do not arrive at the robots.
  void withhold(MessageKind kind) { withheld_ = kind; }
  const host::MapServer& server() const { return *server_; }

 private:
  // Robots are told apart by the port of a made-up address.
  void send(const host::PeerAddress& to, std::span<const std::uint8_t> datagram) override;

  std::vector<std::unique_ptr<SimulatedRobot>>& robots_;
  host::RunDatabase database_{":memory:"};
  std::optional<host::MapServer> server_;
  std::optional<MessageKind> withheld_;
};

}  // namespace ivfm::replay

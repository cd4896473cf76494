#include "tests/replay/robot_team.h"

namespace ivfm::replay {

RobotTeam::RobotTeam(std::vector<std::unique_ptr<SimulatedRobot>>& robots) : robots_(robots) {
  server_.emplace(database_, *this, database_.begin_session(0, 1));
}

void RobotTeam::send(const host::PeerAddress& to, std::span<const std::uint8_t> datagram) {
  const auto kind = static_cast<MessageKind>(datagram[kSealHeaderBytes]);  // nothing is encrypted
  if (kind == withheld_) return;
  const auto port = reinterpret_cast<const sockaddr_in*>(&to.storage)->sin_port;
  robots_.at(port)->radio().to_robot.emplace_back(datagram.begin(), datagram.end());
}

void RobotTeam::exchange(TimeUs now_us) {
  for (std::size_t i = 0; i < robots_.size(); ++i) {
    host::PeerAddress address;
    address.storage.ss_family = AF_INET;
    address.size = sizeof(sockaddr_in);
    reinterpret_cast<sockaddr_in*>(&address.storage)->sin_port = static_cast<in_port_t>(i);
    for (auto& datagram : robots_[i]->radio().from_robot) {
      server_->receive(address, datagram, now_us);
    }
    robots_[i]->radio().from_robot.clear();
  }
  server_->step(now_us);
}

}  // namespace ivfm::replay

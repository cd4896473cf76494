#include "host/map_server/team_radio.h"

#include <netinet/in.h>

#include <algorithm>

namespace ivfm::host {
namespace {

// Robots are told apart by the port of a made-up address.
PeerAddress address_of(std::size_t robot) {
  PeerAddress address;
  address.storage.ss_family = AF_INET;
  address.size = sizeof(sockaddr_in);
  reinterpret_cast<sockaddr_in*>(&address.storage)->sin_port = static_cast<in_port_t>(robot);
  return address;
}

}  // namespace

Result<std::size_t> RadioQueue::receive(std::span<std::uint8_t> buffer) {
  if (to_robot.empty()) return Status::kEmpty;
  const Datagram datagram = to_robot.front();
  to_robot.erase(to_robot.begin());
  std::copy(datagram.begin(), datagram.end(), buffer.begin());
  return datagram.size();
}

Status RadioQueue::send(std::span<const std::uint8_t> datagram) {
  from_robot.emplace_back(datagram.begin(), datagram.end());
  return Status::kOk;
}

void TeamRadio::send(const PeerAddress& to, std::span<const std::uint8_t> datagram) {
  const auto kind = static_cast<MessageKind>(datagram[kSealHeaderBytes]);  // nothing is encrypted
  if (kind == withheld_) return;
  const auto robot = reinterpret_cast<const sockaddr_in*>(&to.storage)->sin_port;
  robots_.at(robot)->to_robot.emplace_back(datagram.begin(), datagram.end());
}

void TeamRadio::exchange(TimeUs now_us) {
  for (std::size_t i = 0; i < robots_.size(); ++i) {
    for (auto& datagram : robots_[i]->from_robot) server_.receive(address_of(i), datagram, now_us);
    robots_[i]->from_robot.clear();
  }
  server_.step(now_us);
}

}  // namespace ivfm::host

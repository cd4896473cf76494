// A radio without loss between robots in one process and their map server, for simulated time.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "firmware/hal/datagram_socket.h"
#include "host/map_server/map_server.h"

namespace ivfm::host {

// One robot's end.
class RadioQueue final : public DatagramSocket {
 public:
  using Datagram = std::vector<std::uint8_t>;
  Result<std::size_t> receive(std::span<std::uint8_t> buffer) override;
  Status send(std::span<const std::uint8_t> datagram) override;

  std::vector<Datagram> to_robot, from_robot;
};

// The server, without a database: the run is forgotten.
class TeamRadio final : public DatagramSender {
 public:
  // One robot more. The queue must outlive this object.
  void add(RadioQueue& robot) { robots_.push_back(&robot); }
  void send(const PeerAddress& to, std::span<const std::uint8_t> datagram) override;
  // Hears what the robots sent, answers what is due.
  void exchange(TimeUs now_us);
  // From now on messages of this kind do not arrive at the robots.
  void withhold(MessageKind kind) { withheld_ = kind; }

  const MapServer& server() const { return server_; }

 private:
  std::vector<RadioQueue*> robots_;
  MapServer server_{*this, 1};
  std::optional<MessageKind> withheld_;
};

}  // namespace ivfm::host

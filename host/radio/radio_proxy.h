// A bad radio between real processes: passes UDP datagrams on, with faults, both ways.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "firmware/hal/fake/faulty_channel.h"
#include "firmware/hal/linux/linux_clock.h"
#include "firmware/hal/linux/udp_socket.h"
#include "host/map_server/peer_address.h"
#include "host/map_server/udp_listener.h"

namespace ivfm::host {

struct RadioProxyOptions {
  std::string listen = "127.0.0.1:7701";  // HOST:PORT for the robots; port 0 takes a free one
  std::string to = "127.0.0.1:7700";      // the map server
  RadioFaults faults;                     // of each robot's way there, and of its way back
  std::uint32_t seed = 1;
  double time_scale = 1;  // how many seconds pass for the radio in one second
};

// Every sender has two channels of its own, seeded by its number in order of appearance, and a
// socket of its own to the server. All calls from one thread.
class RadioProxy {
 public:
  static constexpr std::size_t kMaxClients = 1000;  // the longest silent one makes room

  // Throws std::runtime_error with one sentence when an address cannot be used.
  explicit RadioProxy(RadioProxyOptions options);

  // The address in use, with the real port.
  std::string listening_on() const { return listener_.text(); }
  // Passes on what has arrived and is due; waits up to `timeout_ms` when there is nothing.
  void step(int timeout_ms);
  // From now on the radio is perfect; what is in the air keeps its fate.
  void end_faults();
  // Of both ways of all senders.
  RadioCounters counters() const;
  std::size_t client_count() const { return clients_.size(); }

 private:
  struct Client {
    Client(const PeerAddress& from, const RadioProxyOptions& options, std::uint32_t number);
    PeerAddress address;
    UdpSocket server;
    FaultyChannel up, down;
    TimeUs last_heard_us = 0;
  };

  void wait(int timeout_ms);
  Client& client_of(const PeerAddress& from);
  void take_from_robots(TimeUs now_us);
  void take_from_server(Client& client, TimeUs now_us);
  void deliver(Client& client, TimeUs now_us);

  RadioProxyOptions options_;
  LinuxClock clock_;
  UdpListener listener_;
  std::vector<std::unique_ptr<Client>> clients_;
  std::uint32_t clients_seen_ = 0;
  RadioCounters forgotten_;  // of clients that made room
  std::vector<std::uint8_t> buffer_;
};

}  // namespace ivfm::host

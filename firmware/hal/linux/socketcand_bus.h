// Port: a CAN bus behind a socketcand server (`ivfm canbus`, or the real daemon), over TCP.
#pragma once

#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "firmware/hal/can_bus.h"
#include "firmware/hal/linux/socketcand_protocol.h"

namespace ivfm {

// Non-blocking; connects by itself, and again whenever the server comes back. No heap after open().
class SocketcandBus final : public CanBus {
 public:
  SocketcandBus() = default;
  ~SocketcandBus() { disconnect(); }
  SocketcandBus(const SocketcandBus&) = delete;
  SocketcandBus& operator=(const SocketcandBus&) = delete;

  // Looks the host up and waits up to `wait_ms` until the bus is open. kInvalidArgument: bus name
  // (1 to 16 characters without blanks or brackets); kUnavailable: host unknown or no server there
  // (`error` says which); kRefused: the server does not open this bus. After kUnavailable for want
  // of a server the object goes on trying.
  Status open(const std::string& host, const std::string& port, std::string_view bus, int wait_ms,
              std::string& error);

  Result<CanFrame> receive() override;
  Status send(const CanFrame& frame) override;

  bool connected() const { return state_ == State::kRaw; }
  // The socket to poll for input; -1 while there is none.
  int poll_fd() const { return fd_; }
  std::uint32_t connections() const { return connections_; }
  // Messages that were malformed, oversized or carried extended identifiers.
  std::uint32_t ignored() const { return ignored_ + tokenizer_.oversized(); }

 private:
  enum class State : std::uint8_t {
    kDisconnected,
    kConnecting,
    kGreeting,
    kOpening,
    kSwitching,
    kRaw
  };

  void service();
  void connect_now();
  void finish_connect();
  void disconnect();
  bool fill();  // reads what is there; false when nothing came
  void on_handshake(std::string_view message);
  void queue(std::string_view text);
  void flush();

  sockaddr_storage address_{};
  socklen_t address_size_ = 0;
  std::array<char, 17> bus_{};
  State state_ = State::kDisconnected;
  int fd_ = -1;
  std::uint64_t retry_us_ = 0;
  std::uint64_t handshake_deadline_us_ = 0;
  bool refused_ = false;
  std::uint32_t connections_ = 0;
  std::uint32_t ignored_ = 0;
  SocketcandTokenizer tokenizer_;
  std::array<char, 16384> out_{};
  std::size_t out_size_ = 0;
};

}  // namespace ivfm

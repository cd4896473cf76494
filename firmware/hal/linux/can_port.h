// The CAN bus that a URL names: `socketcan:can0` or `socketcand:HOST:PORT/BUS`.
#pragma once

#include <string>
#include <string_view>
#include <variant>

#include "firmware/hal/linux/socketcan_bus.h"
#include "firmware/hal/linux/socketcand_bus.h"

namespace ivfm {

// The parts of a URL; `host` is empty for SocketCAN.
struct CanUrl {
  std::string host;
  std::string port;
  std::string bus;  // or the interface
};

// kInvalidArgument: `text` is no such URL; `error` says what would be one.
Result<CanUrl> parse_can_url(std::string_view text, std::string& error);

// Owns the bus. A forwarding CanBus, so that it may be handed on before open().
class CanPort final : public CanBus {
 public:
  // Opens the bus that `url` names; waits up to `wait_ms` for a socketcand server. kOk, or why not
  // with one sentence in `error`: kInvalidArgument, kUnsupported, kUnavailable, kRefused, kIoError.
  Status open(std::string_view url, int wait_ms, std::string& error);

  // kUnavailable also before open().
  Result<CanFrame> receive() override;
  Status send(const CanFrame& frame) override;

  // The descriptor to poll for input; -1 while there is none. It changes on reconnection.
  int poll_fd() const;

 private:
  std::variant<std::monostate, SocketCanBus, SocketcandBus> bus_;
};

}  // namespace ivfm

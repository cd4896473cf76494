#include "firmware/hal/linux/can_port.h"

namespace ivfm {

Result<CanUrl> parse_can_url(std::string_view text, std::string& error) {
  constexpr std::string_view kKernel = "socketcan:", kServer = "socketcand:";
  CanUrl url;
  if (text.substr(0, kKernel.size()) == kKernel) {
    url.bus = text.substr(kKernel.size());
    if (!url.bus.empty()) return url;
  } else if (text.substr(0, kServer.size()) == kServer) {
    const std::string_view rest = text.substr(kServer.size());
    const std::size_t slash = rest.rfind('/');
    const std::size_t colon = rest.substr(0, slash).rfind(':');
    if (slash != rest.npos && colon != rest.npos) {
      url.host = rest.substr(0, colon);
      if (url.host.size() > 2 && url.host.front() == '[' && url.host.back() == ']') {
        url.host = url.host.substr(1, url.host.size() - 2);  // [::1]
      }
      url.port = rest.substr(colon + 1, slash - colon - 1);
      url.bus = rest.substr(slash + 1);
    }
    if (!url.host.empty() && !url.port.empty() && !url.bus.empty()) return url;
  }
  error = "CAN URL '" + std::string(text) +
          "' is neither socketcan:INTERFACE nor socketcand:HOST:PORT/BUS";
  return Status::kInvalidArgument;
}

Status CanPort::open(std::string_view url, int wait_ms, std::string& error) {
  const Result<CanUrl> parts = parse_can_url(url, error);
  if (!parts.ok()) return parts.status();
  if (parts->host.empty()) return bus_.emplace<SocketCanBus>().open(parts->bus, error);
  return bus_.emplace<SocketcandBus>().open(parts->host, parts->port, parts->bus, wait_ms, error);
}

Result<CanFrame> CanPort::receive() {
  if (auto* kernel = std::get_if<SocketCanBus>(&bus_)) return kernel->receive();
  if (auto* server = std::get_if<SocketcandBus>(&bus_)) return server->receive();
  return Status::kUnavailable;
}

Status CanPort::send(const CanFrame& frame) {
  if (auto* kernel = std::get_if<SocketCanBus>(&bus_)) return kernel->send(frame);
  if (auto* server = std::get_if<SocketcandBus>(&bus_)) return server->send(frame);
  return Status::kUnavailable;
}

int CanPort::poll_fd() const {
  if (const auto* kernel = std::get_if<SocketCanBus>(&bus_)) return kernel->poll_fd();
  if (const auto* server = std::get_if<SocketcandBus>(&bus_)) return server->poll_fd();
  return -1;
}

}  // namespace ivfm

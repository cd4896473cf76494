#include "host/canbus/can_server.h"

#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <stdexcept>

namespace ivfm::host {
namespace {

constexpr std::size_t kMaxClients = 128;
constexpr std::size_t kMaxBusName = 16;
constexpr std::uint64_t kRawHoldUs = 20'000;
constexpr std::uint64_t kLogFlushUs = 200'000;
constexpr int kReadsPerTurn = 16;  // so that one busy client does not keep the others waiting

// Microseconds of a clock since its epoch.
template <typename Clock>
std::uint64_t time_of() {
  return static_cast<std::uint64_t>(
      std::chrono::duration_cast<std::chrono::microseconds>(Clock::now().time_since_epoch())
          .count());
}
std::uint64_t monotonic_us() { return time_of<std::chrono::steady_clock>(); }
std::uint64_t wall_us() { return time_of<std::chrono::system_clock>(); }

bool good_bus_name(std::string_view name) {
  return !name.empty() && name.size() <= kMaxBusName &&
         std::all_of(name.begin(), name.end(),
                     [](char c) { return c > ' ' && c < 127 && c != '<' && c != '>'; });
}

}  // namespace

std::string format_candump(std::uint64_t time_us, std::string_view bus,
                           const SocketcandFrame& frame) {
  std::array<char, 96> text;
  int size = std::snprintf(text.data(), text.size(), frame.extended ? " %08X#" : " %03X#",
                           static_cast<unsigned>(frame.id));
  std::string line = "(";
  std::array<char, 40> time;
  std::snprintf(time.data(), time.size(), "%010llu.%06llu",
                static_cast<unsigned long long>(time_us / 1'000'000),
                static_cast<unsigned long long>(time_us % 1'000'000));
  line.append(time.data()).append(") ").append(bus);
  const auto add = [&](const char* format, unsigned value) {
    size += std::snprintf(text.data() + size, text.size() - static_cast<std::size_t>(size), format,
                          value);
  };
  if (frame.remote) {
    text[static_cast<std::size_t>(size++)] = 'R';
    if (frame.size > 0) add("%u", frame.size);
  } else {
    for (std::uint8_t i = 0; i < frame.size; ++i) add("%02X", frame.data[i]);
  }
  line.append(text.data(), static_cast<std::size_t>(size)).push_back('\n');
  return line;
}

CanServer::CanServer(const CanServerOptions& options)
    : options_(options), start_wall_us_(wall_us()), start_us_(monotonic_us()) {
  for (const std::string& bus : options.buses) {
    if (!good_bus_name(bus)) {
      throw std::runtime_error("bus name '" + bus +
                               "' must have 1 to 16 characters without blanks");
    }
  }
  if (!options.log_path.empty()) {
    log_.open(options.log_path, std::ios::trunc);
    if (!log_) {
      throw std::runtime_error("cannot write the CAN log " + options.log_path + ": " +
                               std::strerror(errno));
    }
  }
  listen_on(options);
  wake_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
}

CanServer::~CanServer() {
  for (const Client& client : clients_) close(client.fd);
  if (listener_ >= 0) close(listener_);
  if (wake_ >= 0) close(wake_);
}

void CanServer::listen_on(const CanServerOptions& options) {
  const std::string where = options.host + ":" + options.port;
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE;
  addrinfo* found = nullptr;
  const char* host = options.host.empty() ? nullptr : options.host.c_str();
  if (const int code = getaddrinfo(host, options.port.c_str(), &hints, &found); code != 0) {
    throw std::runtime_error("cannot look up " + where + ": " + gai_strerror(code));
  }
  listener_ = socket(found->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  const int on = 1;
  setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  const bool good = listener_ >= 0 && bind(listener_, found->ai_addr, found->ai_addrlen) == 0 &&
                    listen(listener_, SOMAXCONN) == 0;
  const int code = errno;
  freeaddrinfo(found);
  if (!good) {
    if (listener_ >= 0) close(listener_);
    throw std::runtime_error("cannot listen on " + where + ": " + std::strerror(code) +
                             (code == EADDRINUSE ? " (choose another port)" : ""));
  }
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
  port_ =
      ntohs(address.ss_family == AF_INET6 ? reinterpret_cast<const sockaddr_in6&>(address).sin6_port
                                          : reinterpret_cast<const sockaddr_in&>(address).sin_port);
}

std::uint64_t CanServer::time_stamp_us() const {
  const auto elapsed = static_cast<double>(monotonic_us() - start_us_);
  return start_wall_us_ + static_cast<std::uint64_t>(elapsed * options_.time_scale);
}

void CanServer::run() {
  while (!stopping_) poll_once(1'000);
  log_.flush();
}

void CanServer::stop() {
  stopping_ = true;
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = write(wake_, &one, sizeof one);
}

void CanServer::poll_once(int timeout_ms) {
  std::vector<pollfd> waiting = {{listener_, POLLIN, 0}, {wake_, POLLIN, 0}};
  const std::uint64_t before_us = monotonic_us();
  for (const Client& client : clients_) {
    const bool held = client.hold_until_us > before_us;
    if (held) timeout_ms = std::min(timeout_ms, 5);
    const bool writes = !client.out.empty() && !held;
    waiting.push_back({client.fd, static_cast<short>(POLLIN | (writes ? POLLOUT : 0)), 0});
  }
  if (poll(waiting.data(), waiting.size(), timeout_ms) < 0 && errno != EINTR) {
    throw std::runtime_error(std::string("poll: ") + std::strerror(errno));
  }
  std::size_t i = 2;
  for (Client& client : clients_) {
    if (waiting[i++].revents & (POLLIN | POLLHUP | POLLERR)) read_client(client);
  }
  if (waiting[0].revents & POLLIN) accept_clients();
  for (Client& client : clients_) flush(client);
  drop_gone();
  const std::uint64_t now_us = monotonic_us();
  if (log_.is_open() && now_us >= log_flush_us_) {
    log_.flush();
    log_flush_us_ = now_us + kLogFlushUs;
  }
}

void CanServer::accept_clients() {
  for (;;) {
    const int fd = accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (fd < 0) return;
    const int on = 1;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    Client& client = clients_.emplace_back();
    client.fd = fd;
    ++client_count_;
    if (clients_.size() > kMaxClients) {
      refuse(client, "too many clients");
    } else {
      answer(client, "< hi >");
    }
  }
}

void CanServer::read_client(Client& client) {
  for (int reads = 0; reads < kReadsPerTurn && !client.gone && !client.closing; ++reads) {
    const std::span<char> space = client.tokenizer.free_space();
    const ssize_t size = recv(client.fd, space.data(), space.size(), 0);
    if (size <= 0) {
      client.gone = size == 0 || (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR);
      return;
    }
    client.tokenizer.commit(static_cast<std::size_t>(size));
    for (;;) {
      const Result<std::string_view> message = client.tokenizer.next();
      if (!message.ok() || client.closing) break;
      on_message(client, *message);
    }
    if (client.tokenizer.oversized() != client.oversized_told) {
      client.oversized_told = client.tokenizer.oversized();
      ++malformed_;
      answer(client, "< error message too long >");
    }
  }
}

void CanServer::on_message(Client& client, std::string_view message) {
  if (message == "echo") return answer(client, "< echo >");
  if (client.mode == Mode::kNoBus) return on_open(client, message);
  if (set_mode(client, message)) return;
  on_send(client, message);
}

void CanServer::on_open(Client& client, std::string_view message) {
  constexpr std::string_view kOpen = "open ";
  if (message.substr(0, kOpen.size()) != kOpen) {
    ++malformed_;
    return answer(client, "< error unknown command >");
  }
  std::string_view name = message.substr(kOpen.size());
  while (!name.empty() && name.front() == ' ') name.remove_prefix(1);
  const bool declared =
      options_.buses.empty() ||
      std::find(options_.buses.begin(), options_.buses.end(), name) != options_.buses.end();
  if (!good_bus_name(name) || !declared) return refuse(client, "could not open bus");
  client.bus = name;
  client.mode = Mode::kBroadcast;
  answer(client, "< ok >");
}

bool CanServer::set_mode(Client& client, std::string_view message) {
  if (message == "rawmode") {
    client.mode = Mode::kRaw;
    answer(client, "< ok >");
    flush(client);
    // python-can 4.1 reads "< ok >" with one recv() and fails when frames follow in the same
    // segment: they wait a moment.
    client.hold_until_us = monotonic_us() + kRawHoldUs;
  } else if (message == "bcmmode" || message == "controlmode") {
    client.mode = message == "bcmmode" ? Mode::kBroadcast : Mode::kControl;
    answer(client, "< ok >");
  } else {
    return false;
  }
  return true;
}

void CanServer::on_send(Client& client, std::string_view message) {
  const Result<SocketcandFrame> frame = parse_socketcand_send(message);
  if (frame.ok() && client.mode != Mode::kControl) return deliver(&client, client.bus, *frame);
  ++malformed_;
  const bool corrupt = frame.status() == Status::kCorrupt && client.mode != Mode::kControl;
  answer(client, corrupt ? "< error syntax error in send command >" : "< error unknown command >");
}

void CanServer::deliver(const Client* from, const std::string& bus, const SocketcandFrame& frame) {
  ++frames_;
  const std::uint64_t time_us = time_stamp_us();
  if (log_.is_open()) log(time_us, bus, frame);
  std::array<char, kMaxSocketcandMessage> text;
  const std::size_t size = format_socketcand_frame(frame, time_us, text);
  for (Client& client : clients_) {
    if (&client == from || client.mode != Mode::kRaw || client.bus != bus) continue;
    answer(client, std::string_view(text.data(), size));
  }
}

void CanServer::log(std::uint64_t time_us, const std::string& bus, const SocketcandFrame& frame) {
  log_ << format_candump(time_us, bus, frame);
}

void CanServer::answer(Client& client, std::string_view text) {
  if (client.gone || client.closing) return;
  if (client.out.size() + text.size() > options_.max_backlog) {
    ++slow_clients_;
    client.gone = true;
    return;
  }
  client.out.append(text);
}

void CanServer::refuse(Client& client, std::string_view why) {
  ++malformed_;
  answer(client, "< error " + std::string(why) + " >");
  client.closing = true;
}

void CanServer::flush(Client& client) {
  if (client.gone || (!client.out.empty() && monotonic_us() < client.hold_until_us)) return;
  while (!client.out.empty()) {
    const ssize_t size = send(client.fd, client.out.data(), client.out.size(), MSG_NOSIGNAL);
    if (size < 0) {
      client.gone = errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR;
      return;
    }
    client.out.erase(0, static_cast<std::size_t>(size));
  }
  if (client.closing) client.gone = true;
}

void CanServer::drop_gone() {
  clients_.remove_if([](const Client& client) {
    if (client.gone) close(client.fd);
    return client.gone;
  });
}

}  // namespace ivfm::host

#include "firmware/hal/linux/socketcand_bus.h"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>

namespace ivfm {
namespace {

constexpr std::uint64_t kRetryUs = 250'000;
constexpr std::uint64_t kHandshakeUs = 3'000'000;

std::uint64_t monotonic_us() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<std::uint64_t>(t.tv_sec) * 1'000'000 +
         static_cast<std::uint64_t>(t.tv_nsec) / 1'000;
}

bool good_bus_name(std::string_view bus) {
  return !bus.empty() && bus.size() <= 16 && std::all_of(bus.begin(), bus.end(), [](char c) {
    return c > ' ' && c < 127 && c != '<' && c != '>';
  });
}

}  // namespace

Status SocketcandBus::open(const std::string& host, const std::string& port, std::string_view bus,
                           int wait_ms, std::string& error) {
  if (!good_bus_name(bus)) {
    error = "bus name '" + std::string(bus) + "' must have 1 to 16 characters without blanks";
    return Status::kInvalidArgument;
  }
  disconnect();
  bus_.fill('\0');
  std::copy(bus.begin(), bus.end(), bus_.begin());
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (const int code = getaddrinfo(host.c_str(), port.c_str(), &hints, &found); code != 0) {
    error = "cannot look up " + host + ":" + port + ": " + gai_strerror(code);
    return Status::kUnavailable;
  }
  std::memcpy(&address_, found->ai_addr, found->ai_addrlen);
  address_size_ = found->ai_addrlen;
  freeaddrinfo(found);

  retry_us_ = 0;
  refused_ = false;
  const std::uint64_t deadline_us = monotonic_us() + static_cast<std::uint64_t>(wait_ms) * 1'000;
  for (;;) {
    service();
    if (connected()) return Status::kOk;
    if (refused_) {
      error = "the CAN server at " + host + ":" + port + " refused bus '";
      error.append(bus).append("'");
      return Status::kRefused;
    }
    if (monotonic_us() >= deadline_us) break;
    poll(nullptr, 0, 5);
  }
  error = "no CAN server answers at " + host + ":" + port + " (start one with `ivfm canbus`)";
  return Status::kUnavailable;
}

void SocketcandBus::disconnect() {
  if (fd_ >= 0) close(fd_);
  fd_ = -1;
  state_ = State::kDisconnected;
  retry_us_ = monotonic_us() + kRetryUs;
  out_size_ = 0;
  tokenizer_ = SocketcandTokenizer();
}

void SocketcandBus::connect_now() {
  if (address_size_ == 0) return;
  fd_ = socket(address_.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd_ < 0) return disconnect();
  const int on = 1;
  setsockopt(fd_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  const unsigned patience_ms = 3'000;  // unacknowledged data: the server's machine is gone
  setsockopt(fd_, IPPROTO_TCP, TCP_USER_TIMEOUT, &patience_ms, sizeof patience_ms);
  handshake_deadline_us_ = monotonic_us() + kHandshakeUs;
  const int code = connect(fd_, reinterpret_cast<const sockaddr*>(&address_), address_size_);
  if (code == 0) {
    state_ = State::kGreeting;
  } else if (errno == EINPROGRESS) {
    state_ = State::kConnecting;
  } else {
    disconnect();
  }
}

void SocketcandBus::finish_connect() {
  pollfd waiting{.fd = fd_, .events = POLLOUT, .revents = 0};
  if (poll(&waiting, 1, 0) <= 0) return;
  int code = 0;
  socklen_t size = sizeof code;
  getsockopt(fd_, SOL_SOCKET, SO_ERROR, &code, &size);
  if (code != 0) return disconnect();
  state_ = State::kGreeting;
}

// Brings the connection one step further, as far as that goes without waiting.
void SocketcandBus::service() {
  if (state_ == State::kDisconnected && monotonic_us() >= retry_us_) connect_now();
  if (state_ == State::kConnecting) finish_connect();
  while (state_ != State::kDisconnected && state_ != State::kConnecting && !connected()) {
    const Result<std::string_view> message = tokenizer_.next();
    if (message.ok()) {
      on_handshake(*message);
    } else if (!fill()) {
      break;
    }
  }
  const bool shaking = state_ != State::kDisconnected && !connected();
  if (shaking && monotonic_us() >= handshake_deadline_us_) disconnect();
}

void SocketcandBus::on_handshake(std::string_view message) {
  if (message.substr(0, 5) == "error") {
    refused_ = true;
    return disconnect();
  }
  if (state_ == State::kGreeting && message == "hi") {
    queue("< open ");
    queue(bus_.data());
    queue(" >");
    state_ = State::kOpening;
  } else if (state_ == State::kOpening && message == "ok") {
    queue("< rawmode >");
    state_ = State::kSwitching;
  } else if (state_ == State::kSwitching && message == "ok") {
    state_ = State::kRaw;
    refused_ = false;
    ++connections_;
  } else {
    return;  // frames of the broadcast mode before the switch
  }
  flush();
}

bool SocketcandBus::fill() {
  const std::span<char> space = tokenizer_.free_space();
  const ssize_t size = recv(fd_, space.data(), space.size(), 0);
  if (size > 0) {
    tokenizer_.commit(static_cast<std::size_t>(size));
    return true;
  }
  const bool nothing = size < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR);
  if (!nothing) disconnect();
  return false;
}

Result<CanFrame> SocketcandBus::receive() {
  if (!connected()) service();
  while (connected()) {
    const Result<std::string_view> message = tokenizer_.next();
    if (!message.ok()) {
      flush();
      if (!connected() || !fill()) break;
      continue;
    }
    const Result<SocketcandFrame> frame = parse_socketcand_frame(*message);
    if (frame.ok() && !frame->extended) {
      return CanFrame{.id = static_cast<std::uint16_t>(frame->id),
                      .size = frame->size,
                      .remote = frame->remote,
                      .data = frame->data};
    }
    if (message->substr(0, 5) == "error") return Status::kUnavailable;
    ++ignored_;
  }
  return connected() ? Status::kEmpty : Status::kUnavailable;
}

void SocketcandBus::queue(std::string_view text) {
  std::memcpy(out_.data() + out_size_, text.data(), text.size());
  out_size_ += text.size();
}

void SocketcandBus::flush() {
  while (out_size_ > 0) {
    const ssize_t size = ::send(fd_, out_.data(), out_size_, MSG_NOSIGNAL);
    if (size <= 0) {
      if (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR) disconnect();
      return;
    }
    out_size_ -= static_cast<std::size_t>(size);
    std::memmove(out_.data(), out_.data() + size, out_size_);
  }
}

Status SocketcandBus::send(const CanFrame& frame) {
  if (!connected()) service();
  if (!connected()) return Status::kUnavailable;
  if (out_.size() - out_size_ < kMaxSocketcandMessage) {
    flush();
    if (!connected()) return Status::kUnavailable;
    if (out_.size() - out_size_ < kMaxSocketcandMessage) return Status::kFull;
  }
  const SocketcandFrame wide{
      .id = frame.id, .remote = frame.remote, .size = frame.size, .data = frame.data};
  out_size_ += format_socketcand_send(wide, std::span(out_).subspan(out_size_));
  flush();
  return connected() ? Status::kOk : Status::kUnavailable;
}

}  // namespace ivfm

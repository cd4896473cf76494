#include "firmware/hal/linux/socketcan_bus.h"

#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>

namespace ivfm {
namespace {

constexpr std::uint64_t kRetryUs = 500'000;

std::uint64_t monotonic_us() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<std::uint64_t>(t.tv_sec) * 1'000'000 +
         static_cast<std::uint64_t>(t.tv_nsec) / 1'000;
}

// Standard frames only; and the errors after which frames do not get through.
void set_filters(int fd) {
  const can_filter standard{.can_id = 0, .can_mask = CAN_EFF_FLAG};
  setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, &standard, sizeof standard);
  const can_err_mask_t errors = CAN_ERR_TX_TIMEOUT | CAN_ERR_ACK | CAN_ERR_BUSOFF;
  setsockopt(fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors);
}

}  // namespace

void SocketCanBus::close_now() {
  if (fd_ >= 0) close(fd_);
  fd_ = -1;
}

Status SocketCanBus::open(std::string_view interface, std::string& error) {
  const std::string name(interface);
  if (name.empty() || name.size() >= interface_.size()) {
    error = "CAN interface name '" + name + "' must have 1 to 15 characters";
    return Status::kInvalidArgument;
  }
  interface_.fill('\0');
  std::copy(name.begin(), name.end(), interface_.begin());
  const Status status = open_socket();
  const int code = errno;
  if (status == Status::kUnsupported) {
    error =
        "this kernel has no CAN; use socketcand:HOST:PORT/BUS with a server such as `ivfm canbus`";
  } else if (!ok(status)) {
    error = "cannot open CAN interface " + name + ": " + std::strerror(code) +
            " (is it there and up? `ip link show " + name + "`)";
  }
  return status;
}

// Leaves errno set when it fails.
Status SocketCanBus::open_socket() {
  close_now();
  fd_ = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
  if (fd_ < 0) return errno == EAFNOSUPPORT ? Status::kUnsupported : Status::kIoError;
  ifreq request{};
  std::memcpy(request.ifr_name, interface_.data(), interface_.size());
  sockaddr_can address{};
  address.can_family = AF_CAN;
  const bool found = ioctl(fd_, SIOCGIFINDEX, &request) == 0;
  address.can_ifindex = request.ifr_ifindex;
  const bool up = found && ioctl(fd_, SIOCGIFFLAGS, &request) == 0 && (request.ifr_flags & IFF_UP);
  if (found && !up) errno = ENETDOWN;
  set_filters(fd_);
  if (up && bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) {
    return Status::kOk;
  }
  const int code = errno;
  close_now();
  retry_us_ = monotonic_us() + kRetryUs;
  errno = code;
  return Status::kUnavailable;
}

// The interface went down or away: close, so that a later call tries again.
Status SocketCanBus::on_error(int code) {
  if (code == ENETDOWN || code == ENODEV || code == ENXIO) {
    close_now();
    retry_us_ = monotonic_us() + kRetryUs;
    return Status::kUnavailable;
  }
  return Status::kIoError;
}

Result<CanFrame> SocketCanBus::receive() {
  if (fd_ < 0 && (monotonic_us() < retry_us_ || !ok(open_socket()))) return Status::kUnavailable;
  can_frame raw{};
  for (int errors = 0;; ++errors) {  // error frames must not hold up the frames behind them
    const ssize_t size = read(fd_, &raw, sizeof raw);
    if (size < 0 && errno != EAGAIN && errno != EINTR) return on_error(errno);
    if (size < 0) return errors > 0 ? Status::kUnavailable : Status::kEmpty;
    if (size != sizeof raw || raw.can_dlc > 8) return Status::kIoError;
    if (!(raw.can_id & CAN_ERR_FLAG)) break;
    ++error_frames_;
  }
  CanFrame frame{.id = static_cast<std::uint16_t>(raw.can_id & CAN_SFF_MASK),
                 .size = raw.can_dlc,
                 .remote = (raw.can_id & CAN_RTR_FLAG) != 0};
  if (!frame.remote) std::copy_n(raw.data, frame.size, frame.data.begin());
  return frame;
}

Status SocketCanBus::send(const CanFrame& frame) {
  if (fd_ < 0 && (monotonic_us() < retry_us_ || !ok(open_socket()))) return Status::kUnavailable;
  can_frame raw{};
  raw.can_id = frame.id | (frame.remote ? CAN_RTR_FLAG : 0u);
  raw.can_dlc = frame.size;
  std::copy(frame.data.begin(), frame.data.end(), raw.data);
  if (write(fd_, &raw, sizeof raw) == sizeof raw) return Status::kOk;
  return errno == EAGAIN || errno == ENOBUFS || errno == EINTR ? Status::kFull : on_error(errno);
}

}  // namespace ivfm

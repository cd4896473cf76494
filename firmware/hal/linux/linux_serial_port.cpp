#include "firmware/hal/linux/linux_serial_port.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

namespace ivfm {

LinuxSerialPort::LinuxSerialPort(std::string_view path) {
  if (path.size() < path_.size()) std::copy(path.begin(), path.end(), path_.begin());
}

LinuxSerialPort::~LinuxSerialPort() { close_device(); }

Status LinuxSerialPort::open() {
  if (fd_ >= 0) return Status::kOk;
  Status status = open_device();
  if (ok(status)) status = configure();
  if (ok(status)) status = apply_motor();
  if (!ok(status)) close_device();
  return status;
}

Result<std::size_t> LinuxSerialPort::read(std::span<std::uint8_t> buffer) {
  if (const Status status = open(); !ok(status)) {
    return status == Status::kIoError ? Status::kIoError : Status::kUnavailable;
  }
  if (buffer.empty()) return std::size_t{0};
  const ssize_t size = ::read(fd_, buffer.data(), buffer.size());
  if (size > 0) return static_cast<std::size_t>(size);
  if (size < 0 && (errno == EAGAIN || errno == EINTR)) return std::size_t{0};
  return lose_device(size == 0 ? ENODEV : errno);  // 0 is the hang-up of a terminal
}

Status LinuxSerialPort::write(std::span<const std::uint8_t> bytes) {
  if (const Status status = open(); !ok(status)) {
    return status == Status::kIoError ? Status::kIoError : Status::kUnavailable;
  }
  while (!bytes.empty()) {
    const ssize_t size = ::write(fd_, bytes.data(), bytes.size());
    if (size > 0) {
      bytes = bytes.subspan(static_cast<std::size_t>(size));
    } else if (size < 0 && errno == EINTR) {
      continue;
    } else if (size == 0 || errno == EAGAIN) {
      system_error_ = EAGAIN;
      return Status::kFull;
    } else {
      return lose_device(errno);
    }
  }
  return Status::kOk;
}

Status LinuxSerialPort::set_motor(bool on) {
  motor_wanted_ = on;
  if (fd_ >= 0) return apply_motor();
  const Status status = open();  // applies it, too
  return ok(status) || status == Status::kIoError ? status : Status::kUnavailable;
}

Status LinuxSerialPort::open_device() {
  if (path_[0] == '\0') {
    system_error_ = ENAMETOOLONG;
    return Status::kInvalidArgument;
  }
  fd_ = ::open(path_.data(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd_ < 0) {
    const bool denied = errno == EACCES || errno == EPERM || errno == EBUSY;
    const bool absent = errno == ENOENT || errno == ENODEV || errno == ENXIO || errno == EIO;
    return fail(denied ? Status::kRefused : absent ? Status::kUnavailable : Status::kIoError);
  }
  if (::flock(fd_, LOCK_EX | LOCK_NB) != 0) return fail(Status::kRefused);
  return Status::kOk;
}

Status LinuxSerialPort::configure() {
  termios line{};
  if (::tcgetattr(fd_, &line) != 0) return fail(Status::kInvalidArgument);
  ::cfmakeraw(&line);
  line.c_cflag |= CLOCAL | CREAD;
  // Without HUPCL the motor keeps its state when the port is closed (closing would drop DTR).
  line.c_cflag &= ~static_cast<tcflag_t>(HUPCL | CRTSCTS | CSTOPB | PARENB);
  line.c_cc[VMIN] = 1;
  line.c_cc[VTIME] = 0;
  ::cfsetispeed(&line, B115200);
  ::cfsetospeed(&line, B115200);
  if (::tcsetattr(fd_, TCSANOW, &line) != 0) return fail(Status::kIoError);
  ::tcflush(fd_, TCIFLUSH);
  return Status::kOk;
}

// On Slamtec's USB adapter the motor runs while DTR is off (rplidar_sdk, startMotor()); opening a
// tty turns DTR on.
Status LinuxSerialPort::apply_motor() {
  const int dtr = TIOCM_DTR;
  if (::ioctl(fd_, motor_wanted_ ? TIOCMBIC : TIOCMBIS, &dtr) == 0) return Status::kOk;
  if (errno == ENOTTY || errno == EINVAL) return Status::kOk;  // a pseudo-terminal
  return lose_device(errno);
}

Status LinuxSerialPort::fail(Status status) {
  system_error_ = errno;
  return status;
}

// Closes the port; the next call tries to open it again.
Status LinuxSerialPort::lose_device(int error) {
  system_error_ = error;
  close_device();
  const bool gone = error == EIO || error == ENODEV || error == ENXIO || error == EBADF;
  return gone ? Status::kUnavailable : Status::kIoError;
}

void LinuxSerialPort::close_device() {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

}  // namespace ivfm

#include "host/simulator/pseudo_terminal.h"

#include <fcntl.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <stdexcept>
#include <system_error>

namespace ivfm::host {

namespace fs = std::filesystem;

namespace {

[[noreturn]] void fail(const std::string& what) {
  throw std::runtime_error(what + ": " + std::generic_category().message(errno));
}

}  // namespace

PseudoTerminal::PseudoTerminal(fs::path link) : link_(std::move(link)) {
  near_fd_ = ::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  std::array<char, 128> name{};
  if (near_fd_ < 0 || ::grantpt(near_fd_) != 0 || ::unlockpt(near_fd_) != 0 ||
      ::ptsname_r(near_fd_, name.data(), name.size()) != 0) {
    close_all();
    fail("cannot create a pseudo-terminal");
  }
  device_ = name.data();
  far_fd_ = ::open(device_.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC);
  termios line{};
  if (far_fd_ < 0 || ::tcgetattr(far_fd_, &line) != 0) {
    close_all();
    fail("cannot open pseudo-terminal " + device_);
  }
  ::cfmakeraw(&line);
  ::cfsetispeed(&line, B115200);
  ::cfsetospeed(&line, B115200);
  ::tcsetattr(far_fd_, TCSANOW, &line);

  std::error_code error;
  if (fs::is_symlink(fs::symlink_status(link_, error))) fs::remove(link_, error);
  fs::create_symlink(device_, link_, error);
  if (error) {
    close_all();
    throw std::runtime_error("cannot create the link " + link_.string() + ": " + error.message());
  }
}

PseudoTerminal::~PseudoTerminal() {
  std::error_code error;
  if (fs::read_symlink(link_, error) == fs::path(device_)) fs::remove(link_, error);
  close_all();
}

std::vector<std::uint8_t> PseudoTerminal::read() {
  std::vector<std::uint8_t> bytes(1024);
  const ssize_t size = ::read(near_fd_, bytes.data(), bytes.size());
  bytes.resize(size > 0 ? static_cast<std::size_t>(size) : 0);
  return bytes;
}

std::size_t PseudoTerminal::write(std::span<const std::uint8_t> bytes) {
  std::size_t written = 0;
  while (written < bytes.size()) {
    const ssize_t size = ::write(near_fd_, bytes.data() + written, bytes.size() - written);
    if (size <= 0 && errno != EINTR) break;
    if (size > 0) written += static_cast<std::size_t>(size);
  }
  return written;
}

void PseudoTerminal::close_all() {
  const int error = errno;
  if (far_fd_ >= 0) ::close(far_fd_);
  if (near_fd_ >= 0) ::close(near_fd_);
  far_fd_ = near_fd_ = -1;
  errno = error;
}

}  // namespace ivfm::host

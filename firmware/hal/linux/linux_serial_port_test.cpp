#include "firmware/hal/linux/linux_serial_port.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <stdlib.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <filesystem>
#include <string>
#include <vector>

namespace ivfm {
namespace {

using Bytes = std::vector<std::uint8_t>;

// The other end of a pseudo-terminal.
class Line {
 public:
  Line() {
    master_ = ::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
    EXPECT_GE(master_, 0);
    EXPECT_EQ(::grantpt(master_), 0);
    EXPECT_EQ(::unlockpt(master_), 0);
  }
  ~Line() { unplug(); }
  std::string path() const { return ::ptsname(master_); }
  void unplug() {
    if (master_ >= 0) ::close(master_);
    master_ = -1;
  }
  void send(const Bytes& bytes) {
    EXPECT_EQ(::write(master_, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  }
  Bytes received() {
    Bytes bytes(4096);
    const ssize_t size = ::read(master_, bytes.data(), bytes.size());
    bytes.resize(size > 0 ? static_cast<std::size_t>(size) : 0);
    return bytes;
  }

 private:
  int master_ = -1;
};

Bytes read_all(LinuxSerialPort& port) {
  std::array<std::uint8_t, 512> buffer{};
  const auto size = port.read(buffer);
  if (!size.ok()) return {};
  return {buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(*size)};
}

TEST(LinuxSerialPort, PassesEveryByteUnchangedBothWays) {
  Line line;
  LinuxSerialPort port(line.path());
  ASSERT_EQ(port.open(), Status::kOk);
  Bytes all(256);
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = static_cast<std::uint8_t>(i);
  line.send(all);
  EXPECT_EQ(read_all(port), all);
  EXPECT_EQ(port.write(all), Status::kOk);
  EXPECT_EQ(line.received(), all);
}

TEST(LinuxSerialPort, ReadsNothingWhenNothingCame) {
  Line line;
  LinuxSerialPort port(line.path());
  std::array<std::uint8_t, 8> buffer{};
  const auto size = port.read(buffer);
  ASSERT_TRUE(size.ok());
  EXPECT_EQ(*size, 0u);
}

TEST(LinuxSerialPort, IsSetTo115200Raw) {
  Line line;
  LinuxSerialPort port(line.path());
  ASSERT_EQ(port.open(), Status::kOk);
  const int fd = ::open(line.path().c_str(), O_RDWR | O_NOCTTY);
  termios settings{};
  ASSERT_EQ(::tcgetattr(fd, &settings), 0);
  ::close(fd);
  EXPECT_EQ(::cfgetospeed(&settings), static_cast<speed_t>(B115200));
  EXPECT_EQ(settings.c_lflag & (ICANON | ECHO | ISIG), 0u);
  EXPECT_EQ(settings.c_cflag & CSIZE, static_cast<tcflag_t>(CS8));
}

TEST(LinuxSerialPort, AcceptsTheMotorOnAPseudoTerminal) {
  Line line;
  LinuxSerialPort port(line.path());
  EXPECT_EQ(port.set_motor(true), Status::kOk);
  EXPECT_EQ(port.set_motor(false), Status::kOk);
}

TEST(LinuxSerialPort, NamesTheReasonWhenItCannotOpen) {
  LinuxSerialPort absent("/nowhere/ttyUSB9");
  EXPECT_EQ(absent.open(), Status::kUnavailable);
  EXPECT_EQ(absent.system_error(), ENOENT);
  LinuxSerialPort no_terminal("/dev/null");
  EXPECT_EQ(no_terminal.open(), Status::kInvalidArgument);
  LinuxSerialPort too_long(std::string(300, 'x'));
  EXPECT_EQ(too_long.open(), Status::kInvalidArgument);
}

TEST(LinuxSerialPort, RefusesAPortThatAnotherOneHolds) {
  Line line;
  LinuxSerialPort first(line.path()), second(line.path());
  ASSERT_EQ(first.open(), Status::kOk);
  EXPECT_EQ(second.open(), Status::kRefused);
}

TEST(LinuxSerialPort, ReportsAnUnplugAndComesBackOnTheSamePath) {
  const auto link =
      std::filesystem::temp_directory_path() / ("ivfm-serial-" + std::to_string(::getpid()));
  std::filesystem::remove(link);
  Line before;
  std::filesystem::create_symlink(before.path(), link);
  LinuxSerialPort port(link.string());
  ASSERT_EQ(port.open(), Status::kOk);
  before.unplug();
  std::array<std::uint8_t, 8> buffer{};
  EXPECT_EQ(port.read(buffer).status(), Status::kUnavailable);
  EXPECT_FALSE(port.is_open());
  EXPECT_EQ(port.write(Bytes{1}), Status::kUnavailable);

  Line after;
  std::filesystem::remove(link);
  std::filesystem::create_symlink(after.path(), link);
  EXPECT_EQ(port.write(Bytes{1, 2}), Status::kOk);
  EXPECT_EQ(after.received(), (Bytes{1, 2}));
  std::filesystem::remove(link);
}

TEST(LinuxSerialPort, SaysSoWhenTheLineDoesNotDrain) {
  Line line;
  LinuxSerialPort port(line.path());
  Status status = Status::kOk;
  for (int i = 0; i < 1000 && ok(status); ++i) status = port.write(Bytes(1024, 0x55));
  EXPECT_EQ(status, Status::kFull);
}

}  // namespace
}  // namespace ivfm

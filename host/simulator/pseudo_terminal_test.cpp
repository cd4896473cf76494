#include "host/simulator/pseudo_terminal.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <fstream>
#include <memory>
#include <stdexcept>

#include "firmware/hal/linux/linux_serial_port.h"
#include "firmware/lidar/rplidar_driver.h"
#include "host/simulator/rplidar_terminal.h"

namespace ivfm::host {
namespace {

namespace fs = std::filesystem;

class PseudoTerminalTest : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (fs::temp_directory_path() / "ivfm-pty-XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    dir_ = pattern;
  }
  void TearDown() override { fs::remove_all(dir_); }
  fs::path dir_;
};

TEST_F(PseudoTerminalTest, PassesBytesToTheProgramThatOpensTheLink) {
  PseudoTerminal terminal(dir_ / "robot1.lidar");
  LinuxSerialPort port(terminal.link().string());
  ASSERT_EQ(port.write(std::vector<std::uint8_t>{0xa5, 0x0a, 0x0d, 0x03}), Status::kOk);
  EXPECT_EQ(terminal.read(), (std::vector<std::uint8_t>{0xa5, 0x0a, 0x0d, 0x03}));
  EXPECT_EQ(terminal.write(std::vector<std::uint8_t>{1, 2}), 2u);
  std::array<std::uint8_t, 8> buffer{};
  EXPECT_EQ(*port.read(buffer), 2u);
}

TEST_F(PseudoTerminalTest, LosesBytesInsteadOfBlockingWhenNobodyReads) {
  PseudoTerminal terminal(dir_ / "robot1.lidar");
  const std::vector<std::uint8_t> bytes(1 << 20, 0x55);
  EXPECT_LT(terminal.write(bytes), bytes.size());
}

TEST_F(PseudoTerminalTest, RemovesItsLinkAndReplacesAStaleOne) {
  const fs::path link = dir_ / "robot1.lidar";
  fs::create_symlink("/dev/pts/gone", link);
  { PseudoTerminal terminal(link); }
  EXPECT_FALSE(fs::exists(fs::symlink_status(link)));
}

TEST_F(PseudoTerminalTest, NeverOverwritesAFileAndNamesIt) {
  std::ofstream(dir_ / "robot1.lidar") << "precious";
  try {
    PseudoTerminal terminal(dir_ / "robot1.lidar");
    FAIL() << "must not replace a file";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("robot1.lidar"), std::string::npos);
  }
  EXPECT_EQ(fs::file_size(dir_ / "robot1.lidar"), 8u);
}

TEST_F(PseudoTerminalTest, CarriesScansToTheDriverAndSurvivesTheSimulatorsRestart) {
  auto lidar = std::make_unique<RplidarTerminal>(dir_ / "robot1.lidar");
  LinuxSerialPort port((dir_ / "robot1.lidar").string());
  RplidarDriver driver(port, {});
  int scans = 0;
  TimeUs now_us = 0;
  const auto run = [&](int steps) {
    for (int i = 0; i < steps; ++i, now_us += 10'000) {
      if (lidar) lidar->step(now_us);
      driver.step(now_us);
      if (driver.take_scan() != nullptr) ++scans;
    }
  };
  driver.start(now_us);
  run(200);
  EXPECT_GE(scans, 8);
  lidar.reset();
  run(200);
  lidar = std::make_unique<RplidarTerminal>(dir_ / "robot1.lidar");
  scans = 0;
  run(600);
  EXPECT_GE(scans, 8);
}

}  // namespace
}  // namespace ivfm::host

// The whole CAN path in real time: wheel drive, socketcand client, CAN server, emulated drives.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <string>
#include <thread>

#include "firmware/hal/linux/can_port.h"
#include "firmware/wheel_drive/wheel_drive.h"
#include "host/canbus/can_server.h"
#include "host/simulator/cia402_emulator.h"

namespace ivfm {
namespace {

TimeUs clock_us() {
  using namespace std::chrono;
  return static_cast<TimeUs>(
      duration_cast<microseconds>(steady_clock::now().time_since_epoch()).count());
}

TEST(CanStack, DrivesTwoEmulatedWheelsOverTheUserSpaceBus) {
  host::CanServerOptions options;
  options.port = "0";
  host::CanServer server(options);
  std::thread serving([&] { server.run(); });
  const std::string url = "socketcand:127.0.0.1:" + std::to_string(server.port()) + "/robot1";

  std::atomic<bool> stop{false};
  std::thread simulating([&] {
    CanPort bus;
    std::string error;
    EXPECT_EQ(bus.open(url, 5'000, error), Status::kOk) << error;
    host::Cia402Emulator left({.node_id = 1}), right({.node_id = 2});
    host::DriveGroup drives(bus, {&left, &right});
    while (!stop) {
      drives.step(clock_us());
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });

  CanPort bus;
  std::string error;
  EXPECT_EQ(bus.open(url, 5'000, error), Status::kOk) << error;
  WheelDriveConfig config;
  config.drive.stale_timeout_us = 1'000'000;  // a busy machine must not fail the test
  config.drive.heartbeat_timeout_us = 2'000'000;
  config.drive.master_heartbeat_timeout_ms = 1'000;
  WheelDrive wheels(config, bus);
  const TimeUs end_us = clock_us() + 30'000'000;
  const auto far = [&] { return wheels.positions().valid && wheels.positions().left > 500; };
  while (!far() && clock_us() < end_us) {
    wheels.set_velocity({.v_um_s = 200'000, .omega_mrad_s = 0});
    wheels.step(clock_us());
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  EXPECT_TRUE(far());
  EXPECT_TRUE(wheels.healthy(clock_us()));
  stop = true;
  simulating.join();
  server.stop();
  serving.join();
}

}  // namespace
}  // namespace ivfm

// The SocketCAN port and the wheel drive on a real kernel's vcan0; prints each check, exits 0 or 1.
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string>

#include "firmware/hal/linux/can_port.h"
#include "firmware/wheel_drive/wheel_drive.h"
#include "host/simulator/cia402_emulator.h"

namespace {

using ivfm::CanFrame;
using ivfm::CanPort;
using ivfm::Status;

int g_failures = 0;

void check(bool good, const char* what) {
  std::printf("%s  %s\n", good ? "ok  " : "FAIL", what);
  g_failures += good ? 0 : 1;
}

ivfm::TimeUs clock_us() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<ivfm::TimeUs>(t.tv_sec) * 1'000'000 +
         static_cast<ivfm::TimeUs>(t.tv_nsec) / 1'000;
}

// Gives the ports the time to notice that the interface is back.
void wait_for_reopening(CanPort& a, CanPort& b) {
  for (const ivfm::TimeUs end_us = clock_us() + 2'000'000; clock_us() < end_us; usleep(10'000)) {
    (void)a.receive();
    (void)b.receive();
  }
}

void check_port(CanPort& a, CanPort& b) {
  std::string error;
  check(ok(a.open("socketcan:vcan0", 0, error)), "one end opens vcan0");
  check(ok(b.open("socketcan:vcan0", 0, error)), "so does another");
  CanPort missing;
  check(missing.open("socketcan:vcan9", 0, error) == Status::kUnavailable, error.c_str());
  const CanFrame data{.id = 0x181, .size = 6, .remote = false, .data = {1, 2, 3, 4, 5, 6}};
  const CanFrame remote{.id = 0x701, .size = 1, .remote = true, .data = {}};
  for (const CanFrame& frame : {data, remote}) {
    check(ok(a.send(frame)), "sends a frame");
    const auto received = b.receive();
    check(received.ok() && *received == frame, "the other end receives it");
    check(a.receive().status() == Status::kEmpty, "the sender does not");
  }
  check(std::system("/bin/busybox ip link set vcan0 down") == 0, "vcan0 goes down");
  (void)a.receive();
  check(a.send(data) == Status::kUnavailable, "a send says unavailable");
  check(missing.open("socketcan:vcan0", 0, error) == Status::kUnavailable, error.c_str());
  check(std::system("/bin/busybox ip link set vcan0 up") == 0, "vcan0 comes back");
  wait_for_reopening(a, b);
  check(ok(a.send(data)), "and so do the ports");
  const auto received = b.receive();
  check(received.ok() && *received == data, "with frames");
}

void check_wheels(CanPort& agent, CanPort& robot) {
  ivfm::host::Cia402Emulator left({.node_id = 1}), right({.node_id = 2});
  ivfm::host::DriveGroup drives(robot, {&left, &right});
  ivfm::WheelDriveConfig config;
  config.drive.stale_timeout_us = 500'000;  // an emulated machine is slow
  config.drive.master_heartbeat_timeout_ms = 1'000;
  ivfm::WheelDrive wheels(config, agent);
  const auto rolled = [&] { return wheels.positions().valid && wheels.positions().left > 1'000; };
  for (const ivfm::TimeUs end_us = clock_us() + 20'000'000; clock_us() < end_us && !rolled();
       usleep(1'000)) {
    wheels.set_velocity({.v_um_s = 200'000, .omega_mrad_s = 0});
    wheels.step(clock_us());
    drives.step(clock_us());
  }
  check(rolled() && wheels.healthy(clock_us()), "two CiA 402 drives boot and roll on vcan0");
}

}  // namespace

int main() {
  CanPort a, b;
  check_port(a, b);
  check_wheels(a, b);
  std::printf("%s\n", g_failures == 0 ? "HIL PASSED" : "HIL FAILED");
  return g_failures == 0 ? 0 : 1;
}

// Runs in the emulated machine: takes the frames of the drives' CAN interface to the simulator
// outside and back, once a tick, and starts the shell commands that a scenario asks for.
// Usage: can_bridge INTERFACE PCI_DEVICE     e.g. can_bridge can1 /sys/bus/pci/devices/0000:00:03.0
#include <fcntl.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <stdexcept>
#include <string>

#include "firmware/hal/linux/socketcan_bus.h"
#include "hil/exchange.h"

namespace ivfm::hil {
namespace {

void* map_resource(const std::string& path, std::size_t size) {
  const int file = open(path.c_str(), O_RDWR | O_SYNC | O_CLOEXEC);
  void* memory =
      file < 0 ? MAP_FAILED : mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  if (memory == MAP_FAILED) throw std::runtime_error(path + ": " + std::strerror(errno));
  close(file);
  return memory;
}

// Nothing else runs while a tick is handed over. What the bridge starts is not real-time.
void become_real_time() {
  const sched_param priority{.sched_priority = 50};
  if (sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &priority) != 0) {
    throw std::runtime_error(std::string("no real-time priority: ") + std::strerror(errno));
  }
}

std::int64_t monotonic_ns() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

void sleep_until(std::int64_t time_ns) {
  const timespec t{static_cast<std::time_t>(time_ns / 1'000'000'000),
                   static_cast<long>(time_ns % 1'000'000'000)};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr);
}

// Takes a copy: by the time that the shell gets to run, the next tick may have cleared the memory
// which the simulator wrote the command to.
void start_shell(const std::string& command) {
  std::printf("can_bridge: %s\n", command.c_str());
  std::fflush(stdout);
  const pid_t child = fork();
  if (child == 0) {
    execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
    std::fprintf(stderr, "can_bridge: no shell: %s\n", std::strerror(errno));
    _exit(127);
  }
  if (child < 0) std::fprintf(stderr, "can_bridge: no process: %s\n", std::strerror(errno));
}

// Says which of the shells that have ended did so badly.
void bury_shells() {
  int status = 0;
  for (pid_t child = 0; (child = waitpid(-1, &status, WNOHANG)) > 0;) {
    if (status == 0) continue;
    std::fprintf(stderr, "can_bridge: shell %d ended with status 0x%04x\n", child,
                 static_cast<unsigned>(status));
  }
}

void take_frames(CanBus& bus, Frames& frames) {
  for (frames.count = 0; frames.count < frames.items.size(); ++frames.count) {
    const Result<CanFrame> frame = bus.receive();
    if (!frame.ok()) return;
    frames.items[frames.count] = *frame;
  }
}

void hand_over(Exchange& exchange, const volatile std::uint32_t* slow_register) {
  const std::uint32_t tick = exchange.asked.load() + 1;
  exchange.asked.store(tick);
  while (exchange.answered.load() != tick) (void)*slow_register;
}

[[noreturn]] void run(CanBus& bus, Exchange& exchange, const volatile std::uint32_t* registers) {
  const std::int64_t start_ns = monotonic_ns();
  for (std::int64_t due_ns = start_ns;; due_ns += kTickNs) {
    sleep_until(due_ns);
    exchange.now_us = static_cast<std::uint64_t>(monotonic_ns() - start_ns) / 1'000;
    take_frames(bus, exchange.to_drives);
    hand_over(exchange, registers);
    for (std::uint32_t i = 0; i < exchange.from_drives.count; ++i) {
      const Status status = bus.send(exchange.from_drives.items[i]);
      if (!ok(status)) std::printf("can_bridge: a frame was not sent: %s\n", to_string(status));
    }
    bury_shells();
    if (exchange.command[0] != '\0') start_shell(exchange.command.data());
  }
}

}  // namespace
}  // namespace ivfm::hil

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: can_bridge INTERFACE PCI_DEVICE\n");
    return 2;
  }
  try {
    using namespace ivfm::hil;
    std::string error;
    ivfm::SocketCanBus bus;
    if (!ivfm::ok(bus.open(argv[1], error))) throw std::runtime_error(error);
    const std::string device(argv[2]);
    auto* exchange = static_cast<Exchange*>(map_resource(device + "/resource2", kExchangeBytes));
    const auto* registers =
        static_cast<const volatile std::uint32_t*>(map_resource(device + "/resource0", 256));
    become_real_time();
    run(bus, *exchange, registers);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "can_bridge: %s\n", error.what());
    return 1;
  }
}

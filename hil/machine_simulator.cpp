// Outside the emulated machine: the robot's world, lidar and wheel drives, at the machine's pace,
// and the events of a scenario file. See docs/hil.md.
#include <fcntl.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <toml++/toml.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <deque>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "firmware/wheel_drive/canopen.h"
#include "hil/exchange.h"
#include "host/simulator/simulation.h"
#include "host/simulator/truth_log.h"

namespace ivfm::hil {
namespace {

std::atomic<bool> g_stop{false};

[[noreturn]] void fail(const std::string& what) {
  throw std::runtime_error(what + ": " + std::strerror(errno));
}

// --- the scenario ---------------------------------------------------------------------------

// Marks the scenario's end, as the events' numbers mark them; judge.py knows it.
constexpr std::uint8_t kFinish = 0xff;

// What happens at one moment, and what ends it again after a while.
struct Event {
  std::uint8_t number = 0;
  TimeUs at_us = 0;                   // not before this moment, and not before both wheels turn
  TimeUs lasts_us = 0;                // 0: ends never, or by itself
  std::string fault;                  // of the simulator, as in `ivfm sim --fault`, without times
  std::int64_t noise = 0;             // random bytes a tick on the lidar's line; 57 fill it
  std::string run, then_run;          // in the machine's shell
  std::string monitor, then_monitor;  // for QEMU's monitor
};

struct Scenario {
  std::string world;
  TimeUs duration_us = 0;
  std::vector<Event> events;
};

TimeUs to_us(double seconds) { return static_cast<TimeUs>(seconds * 1e6); }

Event read_event(const toml::table& table, std::uint8_t number) {
  const auto text = [&table](const char* key) { return table[key].value_or(std::string{}); };
  return {.number = number,
          .at_us = to_us(table["at"].value_or(0.0)),
          .lasts_us = to_us(table["lasts"].value_or(0.0)),
          .fault = text("fault"),
          .noise = table["noise"].value_or(std::int64_t{0}),
          .run = text("run"),
          .then_run = text("then_run"),
          .monitor = text("monitor"),
          .then_monitor = text("then_monitor")};
}

Scenario read_scenario(const std::string& path) {
  const toml::table table = toml::parse_file(path);
  Scenario scenario;
  scenario.world = table["world"].value_or(std::string{"corridor"});
  scenario.duration_us = to_us(table["duration"].value_or(40.0));
  if (const toml::array* events = table["event"].as_array()) {
    for (const toml::node& node : *events) {
      const auto number = static_cast<std::uint8_t>(scenario.events.size());
      scenario.events.push_back(read_event(*node.as_table(), number));
    }
  }
  return scenario;
}

// --- the machine ----------------------------------------------------------------------------

// The far end of the drives' bus: frames of a tick in, frames of a tick out.
class BridgedBus final : public CanBus {
 public:
  Result<CanFrame> receive() override {
    if (in_.empty()) return Status::kEmpty;
    const CanFrame frame = in_.front();
    in_.pop_front();
    return frame;
  }
  Status send(const CanFrame& frame) override {
    out_.push_back(frame);
    return Status::kOk;
  }
  void take_in(const Frames& frames, TimeUs now_us) {
    for (std::uint32_t i = 0; i < frames.count; ++i) {
      const CanFrame& frame = frames.items[i];
      in_.push_back(frame);
      const bool drives = (frame.id == 0x201 || frame.id == 0x202) && frame.size == 6;
      if (drives && canopen::get_u32(frame, 2) == 0) stood_us_ = now_us;
    }
  }
  // Both wheels have been told to turn for a while.
  bool wheels_turn(TimeUs now_us) const { return now_us - stood_us_ > 300'000; }
  void put_out(Frames& frames) {
    for (frames.count = 0; frames.count < frames.items.size() && !out_.empty(); ++frames.count) {
      frames.items[frames.count] = out_.front();
      out_.pop_front();
    }
  }

 private:
  std::deque<CanFrame> in_, out_;
  TimeUs stood_us_ = 0;
};

// The memory that the machine sees as a PCI device. QEMU opens the file, too.
class SharedMemory {
 public:
  explicit SharedMemory(const std::string& path) {
    const int file = ::open(path.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (file < 0 || ::ftruncate(file, kExchangeBytes) != 0) fail(path);
    void* memory = ::mmap(nullptr, kExchangeBytes, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    ::close(file);
    if (memory == MAP_FAILED) fail(path);
    exchange_ = static_cast<Exchange*>(memory);
  }
  ~SharedMemory() { ::munmap(exchange_, kExchangeBytes); }
  SharedMemory(const SharedMemory&) = delete;
  SharedMemory& operator=(const SharedMemory&) = delete;
  Exchange& exchange() { return *exchange_; }

 private:
  Exchange* exchange_;
};

// Gives QEMU's human monitor a line and waits until it has obeyed.
void tell_monitor(const std::string& path, const std::string& line) {
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::snprintf(address.sun_path, sizeof address.sun_path, "%s", path.c_str());
  if (::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) fail(path);
  const auto wait_for_prompt = [fd, &path] {
    std::string heard;
    while (heard.find("(qemu) ") == std::string::npos) {
      char text[512];
      const ssize_t size = ::read(fd, text, sizeof text);
      if (size <= 0) fail(path);
      heard.append(text, static_cast<std::size_t>(size));
    }
  };
  wait_for_prompt();
  const std::string command = line + "\n";
  if (::write(fd, command.data(), command.size()) < 0) fail(path);
  wait_for_prompt();
  ::close(fd);
}

// Waits until QEMU has taken what is on the lidar's line; at most a while, as it takes no more
// while the machine does not read. True: all is taken.
bool wait_for_line(const host::PseudoTerminal& line) {
  const int fd = ::open(line.device().c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  int waiting = 1;
  for (int i = 0; i < 200 && ::ioctl(fd, FIONREAD, &waiting) == 0 && waiting > 0; ++i) {
    ::usleep(50);
  }
  ::close(fd);
  return waiting == 0;
}

// --- the run --------------------------------------------------------------------------------

class Run {
 public:
  Run(Scenario scenario, host::Simulation& simulation, BridgedBus& bus, SharedMemory& memory,
      std::string monitor)
      : scenario_(std::move(scenario)),
        simulation_(simulation),
        bus_(bus),
        exchange_(memory.exchange()),
        monitor_(std::move(monitor)) {}

  // Waits for the machine's next tick. False: asked to stop.
  bool wait() {
    while (exchange_.asked.load() == exchange_.answered.load()) {
      if (g_stop) return false;
      ::usleep(20);
    }
    return true;
  }

  void tick() {
    const TimeUs now_us = exchange_.now_us;
    exchange_.command[0] = '\0';
    bus_.take_in(exchange_.to_drives, now_us);
    let_happen(now_us);
    simulation_.advance_to(now_us);
    if (running_ != nullptr) make_noise(running_->noise);
    wait_for_lidar(now_us);
    bus_.put_out(exchange_.from_drives);
    exchange_.answered.store(exchange_.asked.load());
  }

 private:
  void let_happen(TimeUs now_us) {
    if (running_ != nullptr) {
      if (now_us < ends_us_) return;
      mark(running_->number, false);
      obey(running_->then_run, running_->then_monitor);
      running_ = nullptr;
    } else if (next_ < scenario_.events.size()) {
      const Event& event = scenario_.events[next_];
      if (now_us < event.at_us || !bus_.wheels_turn(now_us)) return;
      begin(event, now_us);
      ++next_;
    } else if (now_us >= scenario_.duration_us && !finished_) {
      finished_ = true;
      mark(kFinish, true);
      obey("/usr/lib/hil/finish", {});
    }
  }

  void begin(const Event& event, TimeUs now_us) {
    mark(event.number, true);
    if (event.lasts_us > 0) {
      running_ = &event;
      ends_us_ = now_us + event.lasts_us;
    }
    if (!event.fault.empty()) {
      host::Fault fault = host::parse_fault(event.fault + "@0s");
      fault.begin_us = now_us;
      if (event.lasts_us > 0) fault.end_us = ends_us_;
      simulation_.add_fault(fault);
    }
    obey(event.run, event.monitor);
  }

  // On the bus, so that the record of the frames tells the moment.
  void mark(std::uint8_t number, bool begins) {
    CanFrame marker{.id = 0x7f0, .size = 2};
    marker.data = {number, static_cast<std::uint8_t>(begins)};
    (void)bus_.send(marker);
  }

  void obey(const std::string& command, const std::string& monitor_line) {
    if (command.size() >= exchange_.command.size()) {
      throw std::runtime_error("this command is too long: " + command);
    }
    std::copy(command.begin(), command.end(), exchange_.command.begin());
    exchange_.command[command.size()] = '\0';
    if (!monitor_line.empty()) tell_monitor(monitor_, monitor_line);
  }

  void make_noise(std::int64_t bytes) {
    std::vector<std::uint8_t> noise(static_cast<std::size_t>(bytes));
    for (std::uint8_t& byte : noise) byte = static_cast<std::uint8_t>(random_());
    (void)simulation_.robots().front()->lidar().terminal().write(noise);
  }

  void wait_for_lidar(TimeUs now_us) {
    if (!line_flows_ && now_us - line_tried_us_ < 1'000'000) return;
    line_flows_ = wait_for_line(simulation_.robots().front()->lidar().terminal());
    line_tried_us_ = now_us;
  }

  Scenario scenario_;
  host::Simulation& simulation_;
  BridgedBus& bus_;
  Exchange& exchange_;
  std::string monitor_;
  std::size_t next_ = 0;
  const Event* running_ = nullptr;
  TimeUs ends_us_ = 0;
  bool finished_ = false;
  bool line_flows_ = true;
  TimeUs line_tried_us_ = 0;
  std::mt19937 random_{1};
};

struct Options {
  std::string scenario, memory, lidar, monitor, truth;
};

void simulate(const Options& options) {
  Scenario scenario = read_scenario(options.scenario);
  host::WorldRequest request;
  request.name = scenario.world;
  request.robots = 1;
  host::SimulationConfig config;
  config.lidar = host::LidarModel::preset("mild");
  SharedMemory memory(options.memory);
  BridgedBus bus;
  host::Simulation simulation(host::prepare_world(request), config, {options.lidar}, {&bus});
  std::printf("start %s\n", host::format_pose(simulation.world().starts.front()).c_str());
  std::fflush(stdout);
  host::TruthLog truth(options.truth);
  Run run(std::move(scenario), simulation, bus, memory, options.monitor);
  while (run.wait()) {
    run.tick();
    truth.record(simulation, 0);
  }
  const host::RobotBody& body = simulation.robots().front()->body();
  std::printf("driven %.2f m, %d collisions, %.1f s\n", body.travelled_m(), body.collisions(),
              static_cast<double>(simulation.now_us()) / 1e6);
}

}  // namespace
}  // namespace ivfm::hil

int main(int argc, char** argv) {
  CLI::App app{"machine_simulator: world, lidar and drives of the robot in an emulated machine"};
  ivfm::hil::Options options;
  app.add_option("scenario", options.scenario, "scenario file")->required();
  app.add_option("--memory", options.memory, "file of the memory shared with QEMU")->required();
  app.add_option("--lidar", options.lidar, "link to the lidar's line, for QEMU")->required();
  app.add_option("--monitor", options.monitor, "socket of QEMU's monitor")->required();
  app.add_option("--truth", options.truth, "CSV file for the true poses")->required();
  CLI11_PARSE(app, argc, argv);
  struct sigaction action {};
  action.sa_handler = [](int) { ivfm::hil::g_stop = true; };
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGINT, &action, nullptr);
  try {
    ivfm::hil::simulate(options);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "machine_simulator: %s\n", error.what());
    return 1;
  }
}

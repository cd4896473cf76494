// `ivfm-agent`: the robot's program on Linux. Opens the ports, then runs the core without touching
// the heap again.
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <memory>
#include <new>
#include <optional>
#include <stdexcept>
#include <string>

#include "firmware/agent/linux/agent_files.h"
#include "firmware/agent/linux/agent_options.h"
#include "firmware/agent/linux/agent_setup.h"
#include "firmware/agent/linux/telemetry.h"
#include "firmware/hal/linux/can_port.h"
#include "firmware/hal/linux/linux_clock.h"
#include "firmware/hal/linux/linux_serial_port.h"
#include "firmware/hal/linux/radio_key_file.h"
#include "firmware/hal/linux/random_boot.h"
#include "firmware/hal/linux/service_manager.h"
#include "firmware/hal/linux/udp_socket.h"

namespace ivfm {
namespace {

constexpr TimeUs kPeriodUs = 10'000;
constexpr TimeUs kTelemetryPeriodUs = 1'000'000;
constexpr TimeUs kGoodbyeUs = 40'000'000;  // at most so long to hand the last changes over

volatile std::sig_atomic_t stop_signals = 0;

void on_signal(int) { stop_signals = stop_signals + 1; }

void catch_signals() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
}

// A radio that reaches nobody: the robot explores alone.
class NoRadio final : public DatagramSocket {
 public:
  Result<std::size_t> receive(std::span<std::uint8_t>) override { return Status::kEmpty; }
  Status send(std::span<const std::uint8_t>) override { return Status::kOk; }
};

// This robot's key out of a key file. Throws std::runtime_error with one sentence.
SodiumSeal read_seal(const std::string& path, std::int64_t robot) {
  if (!has_encryption()) {
    throw std::runtime_error("this build has no libsodium: it cannot use the key " + path);
  }
  const RadioKeys keys = read_radio_keys(path);
  const auto key = keys.find(static_cast<std::uint16_t>(robot));
  if (key == keys.end()) {
    throw std::runtime_error(path + " holds no key of robot " + std::to_string(robot) +
                             "; give this robot's file, or its number with --robot-id");
  }
  return SodiumSeal(key->second);
}

// The devices of this machine, opened. Throws std::runtime_error with one sentence.
class Devices {
 public:
  explicit Devices(const AgentOptions& options)
      : clock_(options.time_scale), lidar_(options.lidar) {
    if (!options.key.empty()) seal_ = read_seal(options.key, options.robot_id);
    if (!options.server.empty()) open_radio(options);
    const Status status = lidar_.open();
    if (!ok(status)) {
      throw std::runtime_error(
          "cannot open the lidar " + options.lidar + ": " +
          (lidar_.system_error() != 0 ? std::strerror(lidar_.system_error()) : to_string(status)));
    }
    std::string error;
    if (!ok(can_.open(options.can, 5000, error))) throw std::runtime_error(error);
  }

  LinuxClock& clock() { return clock_; }
  AgentPorts ports() {
    DatagramSocket& radio = radio_ ? static_cast<DatagramSocket&>(*radio_) : no_radio_;
    return {lidar_, can_, radio, clock_,
            seal_ ? static_cast<const DatagramSeal&>(*seal_) : kPlainSeal};
  }
  bool has_radio() const { return radio_ != nullptr; }

 private:
  void open_radio(const AgentOptions& options) {
    radio_ = std::make_unique<UdpSocket>(options.server);
    if (!ok(radio_->status())) {
      throw std::runtime_error("cannot reach the map server " + options.server + ": " +
                               radio_->error_text());
    }
    if (seal_ || radio_->peer_is_loopback() || options.plain_radio) return;
    throw std::runtime_error("the radio to " + options.server +
                             " would be readable and open to everybody; give --key FILE (ivfm "
                             "keygen writes one), or --plain-radio where a tunnel protects it");
  }

  LinuxClock clock_;
  LinuxSerialPort lidar_;
  CanPort can_;
  NoRadio no_radio_;
  std::unique_ptr<UdpSocket> radio_;
  std::optional<SodiumSeal> seal_;
};

class Telemetry {
 public:
  explicit Telemetry(const AgentOptions& options) : format_(options.telemetry) {
    if (options.log_file.empty()) return;
    file_ = std::fopen(options.log_file.c_str(), "a");
    if (file_ == nullptr) {
      throw std::runtime_error("cannot write the log " + options.log_file + ": " +
                               std::strerror(errno));
    }
    std::setvbuf(file_, buffer_, _IOLBF, sizeof buffer_);
  }

  void report(const Agent& agent, TimeUs now_us) {
    if (format_ == TelemetryFormat::kOff) return;
    char line[1024];
    const std::size_t size = format_ == TelemetryFormat::kJson
                                 ? format_telemetry_json(agent, now_us, line)
                                 : format_telemetry_line(agent, now_us, line);
    std::fwrite(line, 1, size, file_);
  }

 private:
  TelemetryFormat format_;
  std::FILE* file_ = stderr;
  char buffer_[4096];
};

void say_goodbye(bool has_radio) {
  if (!has_radio) {
    std::fprintf(stderr, "ivfm-agent: stopping\n");
    return;
  }
  std::fprintf(stderr,
               "ivfm-agent: stopping; the rest of the map goes to the server, for %d s at most (a "
               "second signal ends that)\n",
               static_cast<int>(kGoodbyeUs / 1'000'000));
}

// Steps the agent until a signal comes, then lets it stop and hand over what it still has; a second
// signal ends that as soon as the wheels stand.
void run_agent(Agent& agent, Devices& devices, Telemetry& telemetry, ServiceManager& manager) {
  LinuxClock& clock = devices.clock();
  TimeUs next_us = clock.now_us(), telemetry_us = next_us, give_up_us = 0;
  while (true) {
    const TimeUs now_us = clock.now_us();
    if (stop_signals > 0 && give_up_us == 0) {
      give_up_us = now_us + kGoodbyeUs;
      agent.request_stop();
      manager.stopping();
      say_goodbye(devices.has_radio());
    }
    agent.step(now_us);
    manager.alive(now_us);
    if (give_up_us != 0) {
      agent.flush_map();
      const bool standing =
          agent.commanded().is_zero() && agent.wheels().measured_velocity().is_zero();
      const bool shared = !devices.has_radio() || agent.map_is_shared();
      if ((standing && (shared || stop_signals > 1)) || now_us >= give_up_us) break;
    }
    if (now_us - telemetry_us >= kTelemetryPeriodUs) {
      telemetry_us = now_us;
      telemetry.report(agent, now_us);
    }
    next_us += kPeriodUs;
    if (next_us < now_us) next_us = now_us;  // late: no catching up
    clock.sleep_until(next_us);
  }
  telemetry.report(agent, clock.now_us());
}

// All of the agent's memory, a constant of the profile.
template <typename Profile>
AgentFor<Profile>& make_agent(const AgentConfig& config, const AgentPorts& ports) {
  alignas(AgentFor<Profile>) static unsigned char storage[sizeof(AgentFor<Profile>)];
  return *new (storage) AgentFor<Profile>(config, ports);
}

template <typename Profile>
int run(const AgentOptions& options) {
  Devices devices(options);
  Telemetry telemetry(options);
  const auto epoch = static_cast<std::uint32_t>(std::max<std::time_t>(1, std::time(nullptr)));
  const AgentConfig config = make_agent_config(options, Profile::kCellUm, epoch, draw_boot());
  AgentFor<Profile>& agent = make_agent<Profile>(config, devices.ports());
  std::vector<std::uint8_t> model;
  if (!options.model.empty()) {
    model = read_model_file(options.model);
    const ModelStatus loaded = agent.load_model(model);
    if (!ok(loaded.status)) {
      throw std::runtime_error("cannot use the model " + options.model + ": " + loaded.reason);
    }
  }
  catch_signals();
  std::fprintf(stderr, "ivfm-agent: robot %d runs, profile %s, %zu bytes of fixed memory, %s\n",
               static_cast<int>(options.robot_id), Profile::kName, sizeof(AgentFor<Profile>),
               options.model.empty() ? "no model: frontiers alone" : options.model.c_str());
  ServiceManager manager(std::getenv("NOTIFY_SOCKET"));
  manager.ready();
  run_agent(agent, devices, telemetry, manager);
  if (!options.dump_map.empty()) {
    write_map_file(options.dump_map, agent, config.link.robot, agent.link().epoch());
  }
  const bool complete = !devices.has_radio() || agent.map_is_shared();
  std::fprintf(stderr, "ivfm-agent: stopped after %.1f m and %u actions%s\n",
               static_cast<double>(agent.odometry().travelled_um()) / 1e6, agent.progress().actions,
               complete ? "" : "; the server has not confirmed the whole map");
  return 0;
}

int run_profile(const AgentOptions& options) {
  switch (options.profile) {
    case ProfileChoice::kPaper: return run<PaperProfile>(options);
    case ProfileChoice::kMcu: return run<McuProfile>(options);
    case ProfileChoice::kRobot: break;
  }
  return run<RobotProfile>(options);
}

}  // namespace
}  // namespace ivfm

int main(int argc, char** argv) {
  try {
    const auto options = ivfm::parse_agent_options(argc, argv);
    return options ? ivfm::run_profile(*options) : 0;
  } catch (const ivfm::OptionsError& error) {
    std::fprintf(stderr, "ivfm-agent: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "ivfm-agent: %s\n", error.what());
    return 1;
  }
}

#include "host/can_analysis/can_analysis.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>

#include "firmware/wheel_drive/canopen.h"
#include "firmware/wheel_drive/cia402.h"

namespace ivfm::host {
namespace {

using cia402::Command;
using cia402::State;

constexpr double kLate = 1.5;         // periods
constexpr double kSdoTimeoutS = 1.0;  // of an answer
constexpr std::size_t kMostPoints = 4000;
constexpr std::size_t kMostGaps = 200'000;

std::string hex(std::uint32_t value, int digits) {
  char text[16];
  std::snprintf(text, sizeof text, "%0*Xh", digits, value);
  return text;
}

std::string text_of(const char* format, double value) {
  char text[48];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

// "TPDO1_Left" -> "TPDO1".
std::string role_of(const std::string& name) { return name.substr(0, name.find('_')); }

// Times between frames of one kind that should come evenly.
class Pace {
 public:
  // The gap, when there was a frame before.
  std::optional<double> take(double time_s) {
    ++frames_;
    std::optional<double> gap;
    if (last_s_) {
      gap = time_s - *last_s_;
      if (gaps_.size() < kMostGaps) gaps_.emplace_back(*last_s_, *gap);
    }
    last_s_ = time_s;
    return gap;
  }
  // After a reset of a node the next gap means nothing.
  void forget() { last_s_.reset(); }
  void announce(double period_s) { announced_s_ = period_s; }

  double period_s() const {
    if (announced_s_ > 0) return announced_s_;
    std::vector<double> gaps;
    for (const auto& gap : gaps_) gaps.push_back(gap.second);
    if (gaps.empty()) return 0;
    const auto middle = gaps.begin() + static_cast<std::ptrdiff_t>(gaps.size() / 2);
    std::nth_element(gaps.begin(), middle, gaps.end());
    return *middle;
  }
  std::uint64_t frames() const { return frames_; }
  const std::vector<std::pair<double, double>>& gaps() const { return gaps_; }

 private:
  std::uint64_t frames_ = 0;
  std::optional<double> last_s_;
  double announced_s_ = 0;
  std::vector<std::pair<double, double>> gaps_;  // (begin, length)
};

// Follows a drive's statuswords and the controlwords to it.
class DriveWatch {
 public:
  explicit DriveWatch(std::string name) { trace.name = std::move(name); }

  void control(std::uint16_t word) {
    const bool reset = (word & cia402::kControlFaultReset) && !(word_ & cia402::kControlFaultReset);
    word_ = word;
    commands_.insert(cia402::command_of(word));
    if (reset) commands_.insert(Command::kFaultReset);
  }

  // What is wrong with the new state; empty when nothing is.
  std::string status(std::uint16_t word, double time_s) {
    const State state = cia402::state_of(word);
    std::string wrong;
    if (state_ && *state_ != state && !is_reachable(*state_, state)) {
      wrong = std::string("illegal CiA 402 transition from '") + to_string(*state_) + "' to '" +
              to_string(state) + "' (statusword " + hex(word, 4) + ")";
    }
    if (!state_ || *state_ != state) {
      trace.states.push_back({time_s, time_s, static_cast<std::size_t>(state)});
      changed = state_.has_value();
    } else {
      changed = false;
    }
    trace.states.back().end_s = time_s;
    state_ = state;
    commands_ = {cia402::command_of(word_)};
    return wrong;
  }
  // Its power state machine starts anew.
  void forget() { state_.reset(); }
  std::optional<State> state() const { return state_; }

  DriveTrace trace;
  bool changed = false;  // by the last status()

 private:
  // Over the commands since the last statusword and what a drive does by itself.
  bool is_reachable(State from, State to) const {
    std::set<State> reached{from};
    for (std::size_t before = 0; before != reached.size();) {
      before = reached.size();
      for (const State state : std::set<State>(reached)) {
        for (const Command command : commands_) reached.insert(cia402::next_state(state, command));
        add_own_steps(state, reached);
      }
    }
    return reached.contains(to);
  }

  void add_own_steps(State state, std::set<State>& reached) const {
    switch (state) {
      case State::kNotReadyToSwitchOn: reached.insert(State::kSwitchOnDisabled); break;  // 1
      case State::kQuickStopActive: reached.insert(State::kSwitchOnDisabled); break;     // 12
      case State::kFaultReactionActive: reached.insert(State::kFault); break;            // 14
      case State::kReadyToSwitchOn:  // footnote of table 27: 3 and 4 in one go
        if (commands_.contains(Command::kEnableOperation)) {
          reached.insert(State::kOperationEnabled);
        }
        break;
      default: break;
    }
    if (state != State::kFault) reached.insert(State::kFaultReactionActive);  // 13
  }

  std::uint16_t word_ = 0;
  std::set<Command> commands_{Command::kDisableVoltage};
  std::optional<State> state_;
};

// The classes of error codes that drives use, CiA 301 table 26 and CiA 402 annex.
std::string emergency_text(std::uint32_t code) {
  switch (code >> 8) {
    case 0x21:
    case 0x22:
    case 0x23: return " (current)";
    case 0x31:
    case 0x32:
    case 0x33: return " (voltage)";
    case 0x41:
    case 0x42:
    case 0x43: return " (temperature)";
    case 0x73: return " (sensor)";
    case 0x81: return code == 0x8130 ? " (heartbeat of the agent missing)" : " (communication)";
    case 0x82: return " (protocol)";
    case 0x84: return " (velocity)";
    case 0x86: return " (following error)";
    default: return "";
  }
}

std::string abort_text(std::uint32_t code) {
  switch (code) {
    case canopen::kAbortTimeout: return "timed out";
    case canopen::kAbortCommand: return "unknown command";
    case canopen::kAbortAccess: return "unsupported access";
    case canopen::kAbortWriteOnly: return "write only";
    case canopen::kAbortReadOnly: return "read only";
    case canopen::kAbortNoObject: return "no such object";
    case canopen::kAbortNotMappable: return "cannot be mapped";
    case canopen::kAbortTooLong: return "value too long";
    case canopen::kAbortTooShort: return "value too short";
    case canopen::kAbortNoSubIndex: return "no such sub-index";
    case canopen::kAbortValueRange: return "value out of range";
    case canopen::kAbortDeviceState: return "not in this state of the device";
    default: return "abort " + hex(code, 8);
  }
}

}  // namespace

// One bus of a log.
class CanAnalyzer::Bus {
 public:
  Bus(std::string name, const CanAnalyzer& owner) : owner_(owner) { report_.bus = std::move(name); }

  void take(const CanLogFrame& frame, double time_s) {
    now_s_ = time_s;
    if (report_.frames == 0) begin_s_ = time_s;
    ++report_.frames;
    bits_ += (frame.extended ? 67 : 47) + 8ull * frame.size;
    const auto found = owner_.messages_.find(frame.id | (frame.extended ? 0x80000000u : 0u));
    if (found == owner_.messages_.end()) {
      ++report_.frames_by_message["unknown " + hex(frame.id, 3)];
      return;
    }
    const DbcMessage& message = found->second;
    ++report_.frames_by_message[message.name];
    if (frame.remote) return;
    if (frame.size != message.size) {
      violate(message.sender, message.name + " has " + std::to_string(frame.size) +
                                  " bytes instead of " + std::to_string(message.size));
      return;
    }
    dispatch(message, frame);
  }

  BusReport finish() {
    report_.length_s = now_s_ - begin_s_;
    if (report_.length_s > 0) {
      report_.load_bits_per_s = static_cast<double>(bits_) / report_.length_s;
    }
    for (const auto& [what, pace] : paces_) judge(what, pace);
    for (const auto& [node, since] : requests_) {
      if (now_s_ - since > kSdoTimeoutS) violate(node, "an SDO request was never answered");
    }
    std::stable_sort(report_.violations.begin(), report_.violations.end(),
                     [](const CanEvent& a, const CanEvent& b) { return a.time_s < b.time_s; });
    if (report_.violations.size() > BusReport::kMostEvents) {
      report_.violations.resize(BusReport::kMostEvents);
    }
    for (auto& [name, drive] : drives_) report_.drives.push_back(std::move(drive.trace));
    return std::move(report_);
  }

 private:
  std::int64_t raw(const DbcMessage& message, const char* name, const CanLogFrame& frame) const {
    const DbcSignal* signal = message.signal(name);
    return signal == nullptr ? 0 : signal->raw(frame);
  }

  void dispatch(const DbcMessage& message, const CanLogFrame& frame) {
    const std::string role = role_of(message.name);
    if (role == "SYNC") {
      pace("SYNC").take(now_s_);
    } else if (role == "NMT") {
      on_nmt(message, frame);
    } else if (role == "Heartbeat") {
      on_heartbeat(message, frame);
    } else if (role == "EMCY") {
      on_emergency(message, frame);
    } else if (role == "TPDO1") {
      on_status(message, frame);
    } else if (role == "TPDO2") {
      check_operational(message);
    } else if (role == "RPDO1") {
      on_control(message, frame);
    } else if (role == "SDO") {
      on_sdo(message, frame);
    }
  }

  // The drive that a message is from or to: what follows the last '_' in its name.
  static std::string node_of(const DbcMessage& message) {
    const std::string side = message.name.substr(message.name.rfind('_') + 1);
    return side == "Agent" ? side : "Drive" + side;
  }
  DriveWatch& drive(const DbcMessage& message) {
    const std::string name = node_of(message);
    return drives_.try_emplace(name, name).first->second;
  }
  Pace& pace(const std::string& what) { return paces_[what]; }

  void on_nmt(const DbcMessage& message, const CanLogFrame& frame) {
    const auto command = raw(message, "Command", frame);
    const bool reset =
        command == static_cast<std::int64_t>(canopen::NmtCommand::kResetNode) ||
        command == static_cast<std::int64_t>(canopen::NmtCommand::kResetCommunication);
    if (!reset) return;
    for (auto& [name, drive] : drives_) {
      drive.forget();
      pace("heartbeat of " + name).forget();
    }
  }

  void on_heartbeat(const DbcMessage& message, const CanLogFrame& frame) {
    const std::string node = node_of(message);
    const DbcSignal* signal = message.signal("NmtState");
    const std::int64_t state = raw(message, "NmtState", frame);
    if (signal != nullptr && !signal->values.contains(state)) {
      violate(node, "heartbeat with the unknown state " + hex(frame.data[0], 2));
    }
    const std::string name =
        signal != nullptr && signal->values.contains(state) ? signal->values.at(state) : "?";
    Pace& pace_of_node = pace("heartbeat of " + node);
    if (state == 0) {
      pace_of_node.forget();
      if (const auto it = drives_.find(node); it != drives_.end()) {
        if (it->second.state()) note(node, "booted again");
        it->second.forget();
      }
    }
    pace_of_node.take(now_s_);
    nmt_states_[node] = name;
    if (const auto it = drives_.find(node); it != drives_.end()) it->second.trace.nmt_state = name;
  }

  void on_emergency(const DbcMessage& message, const CanLogFrame& frame) {
    const auto code = static_cast<std::uint32_t>(raw(message, "ErrorCode", frame));
    const auto error = static_cast<std::uint32_t>(raw(message, "ErrorRegister", frame));
    note(node_of(message), code == 0 ? "error reset"
                                     : "emergency " + hex(code, 4) + emergency_text(code) +
                                           ", error register " + hex(error, 2));
  }

  void check_operational(const DbcMessage& message) {
    const auto state = nmt_states_.find(node_of(message));
    if (state == nmt_states_.end() || state->second == "operational") return;
    // The first heartbeat after NMT start may come later than the first PDO.
    if (state->second == "pre-operational" || state->second == "boot-up") return;
    violate(node_of(message), message.name + " while the node is " + state->second);
  }

  void on_status(const DbcMessage& message, const CanLogFrame& frame) {
    check_operational(message);
    DriveWatch& watch = drive(message);
    const auto word = static_cast<std::uint16_t>(raw(message, "Statusword", frame));
    const std::string wrong = watch.status(word, now_s_);
    if (!wrong.empty()) violate(watch.trace.name, wrong);
    if (watch.changed &&
        (watch.state() == State::kFault || watch.state() == State::kFaultReactionActive)) {
      note(watch.trace.name, std::string("goes to '") + to_string(*watch.state()) + "'");
    }
    const double speed = static_cast<double>(raw(message, "ActualVelocity", frame));
    watch.trace.fastest = std::max(watch.trace.fastest, std::abs(speed));
    add_point(watch.trace.actual, speed);
  }

  void on_control(const DbcMessage& message, const CanLogFrame& frame) {
    DriveWatch& watch = drive(message);
    watch.control(static_cast<std::uint16_t>(raw(message, "Controlword", frame)));
    add_point(watch.trace.target, static_cast<double>(raw(message, "TargetVelocity", frame)));
  }

  // Adds every point, then every second ... so that a long log stays short.
  void add_point(std::vector<std::pair<double, double>>& curve, double value) {
    auto& [stride, offered] = strides_[&curve];
    if (stride == 0) stride = 1;
    if (offered++ % stride != 0) return;
    if (curve.size() >= kMostPoints) {
      std::size_t kept = 0;
      for (std::size_t i = 0; i < curve.size(); i += 2) curve[kept++] = curve[i];
      curve.resize(kept);
      stride *= 2;
    }
    curve.emplace_back(now_s_, value);
  }

  std::string object_name(std::uint16_t index, std::uint8_t sub) const {
    const auto found = owner_.objects_.find({index, sub});
    return hex(index, 4) + "." + hex(sub, 2) +
           (found == owner_.objects_.end() ? "" : " (" + found->second + ")");
  }

  void on_sdo(const DbcMessage& message, const CanLogFrame& frame) {
    const bool answer = message.name.find("Answer") != std::string::npos;
    const std::string node = node_of(message);
    const auto command = static_cast<unsigned>(raw(message, "Command", frame));
    const auto index = static_cast<std::uint16_t>(raw(message, "Index", frame));
    const auto sub = static_cast<std::uint8_t>(raw(message, "SubIndex", frame));
    const auto value = static_cast<std::uint32_t>(raw(message, "Value", frame));
    if (command == 0x80) {
      note(node, std::string(answer ? "refuses " : "is told to give up ") +
                     object_name(index, sub) + ": " + abort_text(value));
    }
    if (answer) {
      if (requests_.erase(node) == 0 && command != 0x80) {
        violate(node, "answers an SDO request that nobody made: " + object_name(index, sub));
      }
      return;
    }
    if (command == 0x80) {
      requests_.erase(node);
      return;
    }
    const auto open = requests_.find(node);
    if (open != requests_.end() && now_s_ - open->second > kSdoTimeoutS) {
      violate(node,
              "did not answer an SDO request for " + text_of("%.2f s", now_s_ - open->second));
    }
    requests_[node] = now_s_;
    // What the master asks a drive to send as heartbeat time.
    if ((command >> 5) == 1 && index == 0x1017) {
      pace("heartbeat of " + node).announce((value & 0xffffu) / 1e3);
    }
  }

  void judge(const std::string& what, const Pace& pace) {
    ProtocolTiming timing{what, pace.frames(), pace.period_s(), 0, 0, 0};
    for (const auto& [begin_s, length_s] : pace.gaps()) {
      timing.longest_gap_s = std::max(timing.longest_gap_s, length_s);
      if (timing.period_s <= 0 || length_s <= kLate * timing.period_s) continue;
      ++timing.late;
      const double missed = std::round(length_s / timing.period_s) - 1;
      timing.missed += static_cast<std::uint64_t>(std::max(0.0, missed));
      const bool sync = what == "SYNC";
      const std::string after = text_of("%.0f ms after the last", length_s * 1e3) +
                                text_of(" instead of %.0f ms", timing.period_s * 1e3);
      add_violation(begin_s + length_s, sync ? "Agent" : what.substr(what.rfind(' ') + 1),
                    sync ? "late SYNC: " + after
                         : (missed >= 1 ? "missed heartbeat: " : "late heartbeat: ") + after);
    }
    report_.timings.push_back(timing);
  }

  void note(const std::string& who, const std::string& text) {
    ++report_.fault_count;
    if (report_.faults.size() < BusReport::kMostEvents) {
      report_.faults.push_back({now_s_, who, text});
    }
  }
  void violate(const std::string& who, const std::string& text) {
    add_violation(now_s_, who, text);
  }
  void add_violation(double time_s, const std::string& who, const std::string& text) {
    ++report_.violation_count;
    if (report_.violations.size() < 4 * BusReport::kMostEvents) {
      report_.violations.push_back({time_s, who, text});
    }
  }

  const CanAnalyzer& owner_;
  BusReport report_;
  double begin_s_ = 0, now_s_ = 0;
  std::uint64_t bits_ = 0;
  std::map<std::string, DriveWatch> drives_;
  std::map<std::string, Pace> paces_;
  std::map<std::string, std::string> nmt_states_;
  std::map<std::string, double> requests_;  // open SDO requests, since when
  std::map<const void*, std::pair<std::size_t, std::size_t>> strides_;
};

CanAnalyzer::CanAnalyzer(std::string_view dbc, std::string_view eds)
    : messages_(parse_dbc(dbc)), objects_(parse_eds(eds)) {}
CanAnalyzer::~CanAnalyzer() = default;

void CanAnalyzer::take(const CanLogFrame& frame) {
  if (!first_s_) first_s_ = frame.time_s;
  std::unique_ptr<Bus>& bus = buses_[frame.bus];
  if (!bus) bus = std::make_unique<Bus>(frame.bus, *this);
  bus->take(frame, frame.time_s - *first_s_);
}

CanReport CanAnalyzer::finish(const CanLogCounters& counters) {
  CanReport report{counters, {}};
  for (auto& [name, bus] : buses_) report.buses.push_back(bus->finish());
  return report;
}

}  // namespace ivfm::host

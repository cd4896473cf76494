#include "tests/bench/robot_load.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <thread>

#include "firmware/hal/linux/linux_clock.h"
#include "firmware/hal/linux/udp_socket.h"
#include "firmware/link/map_link.h"

namespace ivfm::host {
namespace {

constexpr std::int32_t kCellUm = 50'000;
constexpr std::int32_t kRoomCells = 64;  // each robot's own
constexpr std::int32_t kSightCells =
    24;  // an update is the visits and obstacles of so many squared
constexpr std::int32_t kRoomsInARow = 64;
constexpr double kMaxGreetingS = 30;

CellRect room_of(int robot) {
  return {robot % kRoomsInARow * kRoomCells, robot / kRoomsInARow * kRoomCells, kRoomCells,
          kRoomCells};
}

// A map in which every cell was seen as often as its robot has moved, and a wall runs through.
class RoomMap final : public SharedMap {
 public:
  explicit RoomMap(int robot) : room_(room_of(robot)) {}
  Status read_own(Layer layer, const CellRect& rect, std::span<std::uint8_t> out) const override {
    if (!room_.contains(rect)) return Status::kOutOfRange;
    std::size_t i = 0;
    for (std::int32_t y = rect.y; y < rect.top(); ++y) {
      for (std::int32_t x = rect.x; x < rect.right(); ++x) {
        const bool wall = (x - y) % kSightCells == 0;
        out[i++] = layer == Layer::kVisits ? static_cast<std::uint8_t>(wall ? 0 : visits_ + (x & 1))
                                           : static_cast<std::uint8_t>(wall);
      }
    }
    return Status::kOk;
  }
  Status write_peers(Layer, const CellRect&, std::span<const std::uint8_t>) override {
    return Status::kOk;
  }
  Status restore_own(Layer, const CellRect&, std::span<const std::uint8_t>) override {
    return Status::kOk;
  }
  const CellRect& room() const { return room_; }
  void visit() { visits_ = visits_ < 250 ? visits_ + 1 : 1; }

 private:
  CellRect room_;
  int visits_ = 1;
};

}  // namespace

class RobotLoad::Robot {
 public:
  Robot(int index, const LoadOptions& options, std::uint32_t epoch)
      : map_(index), socket_(options.server), link_(map_, socket_, config_of(index, epoch)) {
    link_.clip(map_.room());
    if (options.updates_per_second > 0) {
      period_us_ = static_cast<TimeUs>(1e6 / options.updates_per_second);
      next_us_ = period_us_ * static_cast<TimeUs>(index) / static_cast<TimeUs>(options.robots);
    }
  }

  bool greeted() const { return link_.all_acknowledged(); }
  const MapLinkCounters& counters() const { return link_.counters(); }

  // Shares what it "saw" when the last update is durable and the next one is due.
  void step(TimeUs now_us, bool sharing, std::vector<double>& acknowledged_s) {
    link_.step(now_us, {});
    if (!link_.all_acknowledged()) return;
    if (sent_us_ != 0) acknowledged_s.push_back(static_cast<double>(now_us - sent_us_) / 1e6);
    sent_us_ = 0;
    if (!sharing || now_us < next_us_) return;
    next_us_ = std::max(next_us_ + period_us_, now_us);  // what it is late for is left out
    share();
    sent_us_ = now_us;
    link_.step(now_us, {});
  }
  void begin(TimeUs now_us) { next_us_ += now_us; }

 private:
  static MapLinkConfig config_of(int index, std::uint32_t epoch) {
    MapLinkConfig config;
    config.robot = static_cast<std::uint16_t>(index + 1);
    config.epoch = epoch;
    config.cell_um = kCellUm;
    config.boot = epoch + 1;
    config.name = "load";
    config.batch_period_us = 1;
    return config;
  }

  // The next place on a way across the room.
  void share() {
    map_.visit();
    const std::int32_t span = kRoomCells - kSightCells;
    place_ = (place_ + 5) % (span * span);
    const CellRect seen{map_.room().x + place_ % span, map_.room().y + place_ / span, kSightCells,
                        kSightCells};
    link_.mark_dirty(Layer::kVisits, seen);
    link_.mark_dirty(Layer::kObstacles, seen);
  }

  RoomMap map_;
  UdpSocket socket_;
  MapLink link_;
  TimeUs period_us_ = 0, next_us_ = 0;
  TimeUs sent_us_ = 0;  // 0: nothing is on its way
  std::int32_t place_ = 0;
};

RobotLoad::RobotLoad(const LoadOptions& options) : options_(options) {
  if (options.robots < 1 || options.robots > 4096 || !(options.seconds > 0) ||
      options.seconds > 600) {
    throw std::runtime_error("a load is 1 to 4096 robots for at most 600 seconds");
  }
  const UdpSocket probe(options.server);
  if (!ok(probe.status())) throw std::runtime_error(options.server + ": " + probe.error_text());
  const auto epoch = static_cast<std::uint32_t>(
      std::chrono::system_clock::to_time_t(std::chrono::system_clock::now()));
  for (int i = 0; i < options.robots; ++i) {
    robots_.push_back(std::make_unique<Robot>(i, options_, epoch));
  }
}

RobotLoad::~RobotLoad() = default;

LoadReport RobotLoad::run() {
  LinuxClock clock;
  LoadReport report;
  const auto step_all = [&](bool sharing) {
    for (const auto& robot : robots_) robot->step(clock.now_us(), sharing, report.acknowledged_s);
    std::this_thread::sleep_for(std::chrono::microseconds(200));
  };
  const auto greeted = [](const auto& robot) { return robot->greeted(); };
  while (!std::all_of(robots_.begin(), robots_.end(), greeted)) {
    step_all(false);
    if (static_cast<double>(clock.now_us()) > kMaxGreetingS * 1e6) {
      throw std::runtime_error("the server at " + options_.server + " does not answer all robots");
    }
  }
  const TimeUs begin_us = clock.now_us();
  for (const auto& robot : robots_) robot->begin(begin_us);
  while (static_cast<double>(clock.now_us() - begin_us) < options_.seconds * 1e6) step_all(true);
  report.seconds = static_cast<double>(clock.now_us() - begin_us) / 1e6;
  report.updates = report.acknowledged_s.size();
  std::sort(report.acknowledged_s.begin(), report.acknowledged_s.end());
  for (const auto& robot : robots_) {
    report.retransmissions += robot->counters().retransmissions;
    report.bytes_sent += robot->counters().bytes_sent;
  }
  return report;
}

double LoadReport::percentile_s(double share) const {
  if (acknowledged_s.empty()) return std::nan("");
  const auto last = static_cast<double>(acknowledged_s.size() - 1);
  return acknowledged_s[static_cast<std::size_t>(std::lround(share * last))];
}

}  // namespace ivfm::host

// Robots without bodies for trying the map server and its page: each drives circles through empty
// rooms and sends what it would see. Usage: emulated_fleet HOST:PORT ROBOTS SECONDS [SERVER.keys]
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "firmware/hal/linux/radio_key_file.h"
#include "firmware/hal/linux/udp_socket.h"
#include "firmware/link/map_link.h"
#include "firmware/supervisor/supervisor_table.h"

namespace ivfm::host {
namespace {

constexpr std::int32_t kCellUm = 50000;
constexpr std::int32_t kRoomCells = 160;  // a room is 8 m wide
constexpr std::int32_t kSightCells = 30;
constexpr double kSpeedMPerS = 1.0;

// One robot's room and what it has seen of it.
class Room final : public SharedMap {
 public:
  explicit Room(std::int32_t number)
      : window_{number % 5 * kRoomCells, number / 5 * kRoomCells, kRoomCells, kRoomCells},
        frame_(kCellUm, window_),
        visits_(frame_.size()),
        obstacles_(frame_.size()) {}

  const CellRect& window() const { return window_; }
  Status read_own(Layer layer, const CellRect& rect, std::span<std::uint8_t> out) const override {
    if (!window_.contains(rect)) return Status::kOutOfRange;
    const auto& cells = layer == Layer::kVisits ? visits_ : obstacles_;
    std::size_t i = 0;
    for (std::int32_t y = rect.y; y < rect.top(); ++y) {
      for (std::int32_t x = rect.x; x < rect.right(); ++x)
        out[i++] = cells[frame_.index_of({x, y})];
    }
    return Status::kOk;
  }
  Status write_peers(Layer, const CellRect&, std::span<const std::uint8_t>) override {
    return Status::kOk;
  }
  Status restore_own(Layer, const CellRect&, std::span<const std::uint8_t>) override {
    return Status::kOk;
  }

  // Counts a visit of everything near `centre`; walls are the room's border. Answers what changed.
  CellRect see(Cell centre) {
    const CellRect sight = CellRect{centre.x - kSightCells, centre.y - kSightCells,
                                    2 * kSightCells + 1, 2 * kSightCells + 1}
                               .intersection(window_);
    for (std::int32_t y = sight.y; y < sight.top(); ++y) {
      for (std::int32_t x = sight.x; x < sight.right(); ++x) {
        if (std::hypot(x - centre.x, y - centre.y) > kSightCells) continue;
        const bool wall =
            x == window_.x || y == window_.y || x == window_.right() - 1 || y == window_.top() - 1;
        auto& cell = (wall ? obstacles_ : visits_)[frame_.index_of({x, y})];
        if (wall || cell < 255) cell = static_cast<std::uint8_t>(wall ? 1 : cell + 1);
      }
    }
    return sight;
  }

 private:
  CellRect window_;
  GridFrame frame_;
  std::vector<std::uint8_t> visits_, obstacles_;
};

class Robot {
 public:
  // Without a key nothing is encrypted.
  Robot(std::uint16_t id, const std::string& server, std::uint32_t epoch, const RadioKeys& keys)
      : room_(id - 1), socket_(server) {
    if (const auto key = keys.find(id); key != keys.end()) seal_.emplace(key->second);
    const DatagramSeal& seal = seal_ ? static_cast<const DatagramSeal&>(*seal_) : kPlainSeal;
    link_.emplace(room_, socket_, config(id, epoch), seal);
    link_->clip(room_.window());
  }

  void step(TimeUs now_us, double dt_s) {
    if (const auto command = link_->take_command()) obey(*command);
    if (state_ == RobotState::kExploring) drive(dt_s);
    RobotStatus status;
    status.state = static_cast<std::uint8_t>(state_);
    status.goal = goal_;
    status.actions = actions_;
    status.distance_mm = static_cast<std::uint32_t>(driven_m_ * 1000);
    status.decision_us = 4000;
    link_->set_status(status);
    link_->step(now_us, pose_);
  }

 private:
  MapLinkConfig config(std::uint16_t id, std::uint32_t epoch) {
    name_ = "emulated " + std::to_string(id);
    MapLinkConfig config;
    config.robot = id;
    config.epoch = epoch;
    config.name = name_;
    config.boot = std::random_device()() + std::uint64_t{1};
    config.batch_period_us = config.status_period_us = 200000;
    return config;
  }

  void obey(CommandCode code) {
    state_ = code == CommandCode::kStart    ? RobotState::kExploring
             : code == CommandCode::kReturn ? RobotState::kReturning
                                            : RobotState::kStopped;
  }

  // A circle that grows and shrinks.
  void drive(double dt_s) {
    driven_m_ += kSpeedMPerS * dt_s;
    const double radius_m = 1.5 + std::sin(driven_m_ / 40);
    angle_ += kSpeedMPerS * dt_s / radius_m;
    const Point middle =
        GridFrame(kCellUm, {})
            .center_of({room_.window().x + kRoomCells / 2, room_.window().y + kRoomCells / 2});
    const auto place = [&](double angle) {
      return Point{middle.x_um + static_cast<std::int32_t>(1e6 * radius_m * std::cos(angle)),
                   middle.y_um + static_cast<std::int32_t>(1e6 * radius_m * std::sin(angle))};
    };
    pose_ = {place(angle_), BinaryAngle::from_radians(std::remainder(angle_ + 1.5708, 6.2831853))};
    if (driven_m_ < next_action_m_) return;
    next_action_m_ = driven_m_ + 1;
    ++actions_;
    goal_ = GridFrame(kCellUm, {}).cell_at(place(angle_ + 1 / radius_m));
    const CellRect seen = room_.see(GridFrame(kCellUm, {}).cell_at(pose_.position));
    link_->mark_dirty(Layer::kVisits, seen);
    link_->mark_dirty(Layer::kObstacles, seen);
  }

  std::string name_;
  Room room_;
  UdpSocket socket_;
  std::optional<SodiumSeal> seal_;
  std::optional<MapLink> link_;
  RobotState state_ = RobotState::kExploring;
  Pose pose_;
  Cell goal_;
  double angle_ = 0, driven_m_ = 0, next_action_m_ = 0;
  std::uint32_t actions_ = 0;
};

int run(const std::string& server, int robots, double seconds, const RadioKeys& keys) {
  const auto begin = std::chrono::steady_clock::now();
  const auto epoch = static_cast<std::uint32_t>(
      std::chrono::system_clock::to_time_t(std::chrono::system_clock::now()));
  std::vector<std::unique_ptr<Robot>> fleet;
  for (int id = 1; id <= robots; ++id) {
    fleet.push_back(std::make_unique<Robot>(static_cast<std::uint16_t>(id), server, epoch, keys));
  }
  double last_s = 0;
  for (double now_s = 0; now_s < seconds; last_s = now_s) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    now_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    for (const auto& robot : fleet) {
      robot->step(static_cast<TimeUs>(now_s * 1e6) + 1, std::min(0.2, now_s - last_s));
    }
  }
  return 0;
}

}  // namespace
}  // namespace ivfm::host

int main(int argc, char** argv) {
  if (argc != 4 && argc != 5) {
    std::fprintf(stderr, "usage: emulated_fleet HOST:PORT ROBOTS SECONDS [SERVER.keys]\n");
    return 2;
  }
  const auto keys = argc == 5 ? ivfm::read_radio_keys(argv[4]) : ivfm::RadioKeys{};
  return ivfm::host::run(argv[1], std::atoi(argv[2]), std::atof(argv[3]), keys);
}

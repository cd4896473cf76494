#include "host/evaluation/wire_meter.h"

#include <algorithm>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "firmware/link/map_link.h"
#include "host/map_server/key_ring.h"
#include "host/map_server/map_server.h"

namespace ivfm::host {
namespace {

constexpr TimeUs kTickUs = 100'000;
constexpr std::uint32_t kEpoch = 1;  // of the server's first start
constexpr TimeUs kGoodbyeUs = 10'000'000;
constexpr std::int64_t kSimStepsPerSecond = 240;

// The environment itself tells the agents what the others saw.
class OwnLayers final : public SharedMap {
 public:
  OwnLayers(const ExplorationEnvironment& env, int agent) : env_(env), agent_(agent) {}
  Status read_own(Layer layer, const CellRect& rect, std::span<std::uint8_t> out) const override {
    return env_.explorer(agent_).map().read_own(layer, rect, out);
  }
  Status write_peers(Layer, const CellRect&, std::span<const std::uint8_t>) override {
    return Status::kOk;
  }
  Status restore_own(Layer, const CellRect&, std::span<const std::uint8_t>) override {
    return Status::kOk;
  }

 private:
  const ExplorationEnvironment& env_;
  int agent_;
};

struct Queue final : DatagramSocket {
  using Datagrams = std::vector<std::vector<std::uint8_t>>;
  Result<std::size_t> receive(std::span<std::uint8_t> buffer) override {
    if (arriving.empty()) return Status::kEmpty;
    const auto datagram = std::move(arriving.front());
    arriving.erase(arriving.begin());
    std::copy(datagram.begin(), datagram.end(), buffer.begin());
    return datagram.size();
  }
  Status send(std::span<const std::uint8_t> datagram) override {
    leaving.emplace_back(datagram.begin(), datagram.end());
    return Status::kOk;
  }
  Datagrams arriving, leaving;
};

struct Member {
  Member(const ExplorationEnvironment& env, int agent, const DatagramSeal& seal)
      : own(env, agent), link(own, radio, config(env, agent), seal) {
    link.clip(env.explorer(agent).map().frame().window());
  }
  static MapLinkConfig config(const ExplorationEnvironment& env, int agent) {
    MapLinkConfig config;
    config.robot = static_cast<std::uint16_t>(agent + 1);
    config.cell_um = env.config().cell_um;
    return config;
  }
  OwnLayers own;
  Queue radio;
  MapLink link;
};

// Every run the same: this is about the number of bytes, not about secrets.
RadioKeys made_up_keys() {
  RadioKeys keys;
  for (std::uint16_t robot = 1; robot <= 64; ++robot) keys[robot] = {};
  return keys;
}

}  // namespace

struct WireMeter::Team final : DatagramSender {
  Team() {
    MapServerConfig config;
    config.seals = &keys;
    server.emplace(*this, kEpoch, config);
  }
  void send(const PeerAddress& to, std::span<const std::uint8_t> datagram) override {
    members.at(static_cast<int>(to.size))
        .radio.arriving.emplace_back(datagram.begin(), datagram.end());
  }
  Member& member(const ExplorationEnvironment& env, int agent) {
    const auto robot = static_cast<std::uint16_t>(agent + 1);
    return members.try_emplace(agent, env, agent, *keys.of(robot)).first->second;
  }
  void tick(const ExplorationEnvironment& env) {
    now_us += kTickUs;
    for (auto& [agent, member] : members) {
      member.link.step(now_us, env.pose(agent));
      PeerAddress from;
      from.size = static_cast<socklen_t>(agent);
      for (auto& datagram : std::exchange(member.radio.leaving, {})) {
        server->receive(from, datagram, now_us);
      }
    }
    server->step(now_us);
  }
  bool is_quiet() const {
    return server->all_delivered() && std::ranges::all_of(members, [](const auto& entry) {
             return entry.second.link.all_acknowledged();
           });
  }

  KeyRing keys{made_up_keys()};
  std::map<int, Member> members;
  std::optional<MapServer> server;
  TimeUs now_us = 1;
  TimeUs until_us = 1;
};

WireMeter::WireMeter(ExplorationEnvironment& env) : env_(env), team_(std::make_unique<Team>()) {
  env_.set_share_observer([this](int agent, Layer layer, const CellRect& rect) {
    team_->member(env_, agent).link.mark_dirty(layer, rect);
  });
}

WireMeter::~WireMeter() { env_.set_share_observer({}); }

void WireMeter::note_action(std::int32_t sim_steps) {
  for (auto& [agent, member] : team_->members) {
    member.link.clip(env_.explorer(agent).map().frame().window());
  }
  const std::int64_t us = std::int64_t{sim_steps} * 1'000'000 / kSimStepsPerSecond;
  const int agents = std::max(1, env_.agents());
  team_->until_us += static_cast<TimeUs>(us / agents);
  while (team_->now_us < team_->until_us) team_->tick(env_);
}

std::uint64_t WireMeter::finish() {
  const TimeUs limit_us = team_->now_us + kGoodbyeUs;
  for (auto& entry : team_->members) entry.second.link.flush();
  do {
    team_->tick(env_);
  } while (!team_->is_quiet() && team_->now_us < limit_us);
  const TrafficCounters& traffic = team_->server->counters().traffic;
  return traffic.bytes_in + traffic.bytes_out;
}

}  // namespace ivfm::host

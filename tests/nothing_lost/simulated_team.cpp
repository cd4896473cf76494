#include "tests/nothing_lost/simulated_team.h"

#include <algorithm>
#include <array>
#include <sstream>
#include <utility>

namespace ivfm::host {
namespace {

constexpr TimeUs kTickUs = 50'000;
constexpr TimeUs kSecond = 1'000'000;
constexpr TimeUs kSettleLimitUs = 120 * kSecond;

PeerAddress address_of(std::size_t robot) {
  PeerAddress address;
  address.size = sizeof(sockaddr_in);
  auto* v4 = reinterpret_cast<sockaddr_in*>(&address.storage);
  v4->sin_family = AF_INET;
  v4->sin_port = htons(static_cast<std::uint16_t>(robot));
  return address;
}

std::size_t robot_at(const PeerAddress& address) {
  return ntohs(reinterpret_cast<const sockaddr_in*>(&address.storage)->sin_port);
}

bool is_down(const std::vector<Outage>& outages, TimeUs now_us) {
  return std::any_of(outages.begin(), outages.end(),
                     [now_us](const Outage& outage) { return outage.contains(now_us); });
}

}  // namespace

struct SimulatedTeam::Member {
  Member(std::uint16_t id, std::uint32_t seed, const FaultSchedule::Robot& plan)
      : outages(plan.outages), radio(seed, plan.radio), robot(id, radio.robot()) {}
  std::vector<Outage> outages;
  FakeRadio radio;
  TeamRobot robot;
};

SimulatedTeam::SimulatedTeam(FaultSchedule schedule, Sabotage sabotage)
    : schedule_(std::move(schedule)), sabotage_(sabotage), random_(schedule_.seed) {
  for (std::size_t i = 0; i < schedule_.robots.size(); ++i) {
    const auto id = static_cast<std::uint16_t>(i + 1);
    members_.push_back(std::make_unique<Member>(id, schedule_.seed * 16 + id, schedule_.robots[i]));
    robots_.push_back(&members_.back()->robot);
  }
  start_server();
}

SimulatedTeam::~SimulatedTeam() = default;

ScheduleReport SimulatedTeam::run() {
  while (now_us_ < schedule_.faulty_until_us && report_.failure.empty()) {
    apply_kills();
    for (TeamRobot* robot : robots_) {
      if (robot->runs()) robot->explore(random_);
    }
    tick();
  }
  end_faults();
  const TimeUs back_us = now_us_;
  if (settle()) {
    report_.settled_after_us = now_us_ - back_us;
    check_equal("once the radio was back");
    kill_server();
    start_server();
    if (settle()) check_equal("after a last restart of the server");
  }
  for (const auto& member : members_) report_.radio += member->radio.counters();
  return report_;
}

// --- The server ----------------------------------------------------------------------------------

void SimulatedTeam::send(const PeerAddress& to, std::span<const std::uint8_t> datagram) {
  if (mute_) return;
  static_cast<void>(members_[robot_at(to) - 1]->radio.server().send(datagram));
}

void SimulatedTeam::start_server() {
  const bool forget = sabotage_ == Sabotage::kServersForget && report_.server_kills > 0;
  database_ = std::make_unique<RunDatabase>(folder_ / (forget ? "other.db" : "run.db"));
  const std::uint32_t epoch = database_->begin_session(0, 1.0);
  DatagramSender& sender = *this;
  server_ = std::make_unique<MapServer>(*database_, sender, epoch);
  check_acknowledged();
}

// Like kill -9: nothing is finished. Sometimes right after a commit, before anything is sent.
void SimulatedTeam::kill_server() {
  mute_ = random_() % 2 == 0;
  if (mute_) server_->step(now_us_ + kTickUs);
  mute_ = false;
  server_.reset();
  database_.reset();
  ++report_.server_kills;
}

// --- Time ----------------------------------------------------------------------------------------

void SimulatedTeam::apply_kills() {
  const bool server_down = is_down(schedule_.server, now_us_);
  if (server_down && server_) kill_server();
  if (!server_down && !server_) start_server();
  for (auto& member : members_) {
    const bool down = is_down(member->outages, now_us_);
    if (down == !member->robot.runs()) continue;
    report_.robot_kills += down ? 1u : 0u;
    down ? member->robot.kill() : member->robot.start();
  }
}

void SimulatedTeam::tick() {
  now_us_ += kTickUs;
  std::array<std::uint8_t, kMaxDatagramBytes> buffer;
  for (auto& member : members_) {
    member->radio.set_now(now_us_);
    if (member->robot.runs()) member->robot.step(now_us_);
    const PeerAddress from = address_of(member->robot.id());
    DatagramSocket& radio = member->radio.server();
    for (auto size = radio.receive(buffer); size.ok(); size = radio.receive(buffer)) {
      if (server_) server_->receive(from, std::span(buffer).first(*size), now_us_);
    }
  }
  if (server_) server_->step(now_us_);
}

void SimulatedTeam::end_faults() {
  schedule_.server.clear();
  for (auto& member : members_) {
    member->outages.clear();
    member->radio.set_faults({});
  }
  apply_kills();
}

// A few seconds first: what is still in the air must change nothing, and a server that has just
// started must hear of the robots before it can tell them anything.
bool SimulatedTeam::settle() {
  const TimeUs give_up_us = now_us_ + kSettleLimitUs;
  for (const TimeUs end_us = now_us_ + 3 * kSecond; now_us_ < end_us;) tick();
  while (now_us_ < give_up_us && !settled()) tick();
  if (!settled()) fail("two minutes after the radio was back", "maps were not handed over");
  return report_.failure.empty();
}

bool SimulatedTeam::settled() const {
  return server_->all_delivered() &&
         std::all_of(robots_.begin(), robots_.end(),
                     [](const TeamRobot* robot) { return robot->link().all_acknowledged(); });
}

// --- What must hold ------------------------------------------------------------------------------

ServerValue SimulatedTeam::server_value() const {
  return [&map = server_->map()](std::uint16_t robot, Layer layer, Cell c) -> unsigned {
    return robot == 0 ? map.merged_value(layer, c) : map.robot_value(robot, layer, c);
  };
}

void SimulatedTeam::check_acknowledged() {
  fail("after a restart", find_missing_cell(robots_, server_value(), report_.cells_checked));
}

void SimulatedTeam::check_equal(const std::string& when) {
  fail(when, find_different_cell(robots_, server_value(), report_.cells_checked));
}

// The first failure counts.
void SimulatedTeam::fail(const std::string& when, const std::string& what) {
  if (what.empty() || !report_.failure.empty()) return;
  std::ostringstream text;
  text << "schedule " << schedule_.seed << ", at " << static_cast<double>(now_us_) / 1e6 << " s, "
       << when << ": " << what;
  report_.failure = text.str();
}

}  // namespace ivfm::host

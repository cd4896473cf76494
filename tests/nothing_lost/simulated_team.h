// A team in simulated time: robots with their real links on bad radios, and the real map server on
// its real database, each killed and started again as a schedule says.
#pragma once

#include <cstdint>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "firmware/hal/fake/fake_datagram.h"
#include "host/map_server/map_server.h"
#include "host/map_server/scratch_folder.h"
#include "tests/nothing_lost/fault_schedule.h"
#include "tests/nothing_lost/team_checks.h"
#include "tests/nothing_lost/team_robot.h"

namespace ivfm::host {

struct ScheduleReport {
  std::string failure;  // a sentence; empty when nothing was lost
  RadioCounters radio;
  std::uint64_t server_kills = 0;
  std::uint64_t robot_kills = 0;
  std::uint64_t cells_checked = 0;
  TimeUs settled_after_us = 0;  // the radio was back
};

class SimulatedTeam : private DatagramSender {
 public:
  // To see that a loss is noticed.
  enum class Sabotage { kNone, kServersForget };

  explicit SimulatedTeam(FaultSchedule schedule, Sabotage sabotage = Sabotage::kNone);
  ~SimulatedTeam();

  // The whole schedule; then, on a perfect radio, until everything is known everywhere, compared;
  // then a last restart of the server, and compared again.
  ScheduleReport run();

 private:
  struct Member;

  void send(const PeerAddress& to, std::span<const std::uint8_t> datagram) override;
  void start_server();
  void kill_server();
  void apply_kills();
  void tick();
  void end_faults();
  bool settle();
  bool settled() const;
  ServerValue server_value() const;
  void check_acknowledged();
  void check_equal(const std::string& when);
  void fail(const std::string& when, const std::string& what);

  FaultSchedule schedule_;
  Sabotage sabotage_;
  ScheduleReport report_;
  std::mt19937 random_;
  ScratchFolder folder_;
  TimeUs now_us_ = 1'000'000;
  std::vector<std::unique_ptr<Member>> members_;
  std::vector<TeamRobot*> robots_;  // the members'
  std::unique_ptr<RunDatabase> database_;
  std::unique_ptr<MapServer> server_;
  bool mute_ = false;  // the server is killed before what it sends now leaves
};

}  // namespace ivfm::host

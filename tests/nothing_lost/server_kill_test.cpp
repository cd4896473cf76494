// kill -9 on a real server process behind a real bad radio, again and again.
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <map>
#include <memory>
#include <random>
#include <thread>

#include "firmware/hal/linux/linux_clock.h"
#include "firmware/hal/linux/udp_socket.h"
#include "host/demo/child_process.h"
#include "host/map_server/map_reader.h"
#include "host/map_server/scratch_folder.h"
#include "host/map_server/udp_listener.h"
#include "tests/nothing_lost/team_checks.h"

namespace ivfm::host {
namespace {

constexpr double kTimeScale = 4;
constexpr int kKills = 6;
constexpr std::chrono::seconds kPatience{100};  // until the test fails

// The server's and the radio's processes, and robots in this one.
class RealTeam {
 public:
  RealTeam() {
    start_server();
    radio_ = start("radio", {"radio", "--faults",
                             "drop=0.3,duplicate=0.1,reorder=0.1,corrupt=0.03,jitter=300ms",
                             "--listen", radio_address_, "--to", server_address_});
    for (std::uint16_t id = 1; id <= 3; ++id) {
      sockets_.push_back(std::make_unique<UdpSocket>(radio_address_));
      members_.push_back(std::make_unique<TeamRobot>(id, *sockets_.back()));
      robots_.push_back(members_.back().get());
    }
  }

  void start_server() {
    server_ = start("serve", {"serve", "--listen", server_address_, "--db", database().string()});
  }
  void kill_server() { server_.reset(); }
  bool stop_server() { return stop_children({server_.get()}, kPatience); }
  void end_faults() { radio_->send_signal(SIGUSR1); }
  void restart_robot(std::size_t index) {
    robots_[index]->kill();
    robots_[index]->start();
  }

  // A turn of all robots; they see new places when `exploring`.
  void turn(bool exploring) {
    for (TeamRobot* robot : robots_) {
      if (exploring) robot->explore(random_);
      robot->step(clock_.now_us());
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  template <typename Done>
  bool turn_until(bool exploring, Done done) {
    const auto give_up = std::chrono::steady_clock::now() + kPatience;
    while (!done()) {
      if (std::chrono::steady_clock::now() > give_up) return false;
      turn(exploring);
    }
    return true;
  }

  std::uint64_t received() const {
    std::uint64_t sum = 0;
    for (const TeamRobot* robot : robots_) sum += robot->link().counters().datagrams_received;
    return sum;
  }
  bool all_acknowledged() const {
    return std::all_of(robots_.begin(), robots_.end(),
                       [](const TeamRobot* robot) { return robot->link().all_acknowledged(); });
  }

  // What the file says, now.
  std::string missing() {
    std::uint64_t cells = 0;
    return find_missing_cell(robots_, file_value(), cells);
  }
  std::string different() {
    std::uint64_t cells = 0;
    return find_different_cell(robots_, file_value(), cells);
  }
  std::mt19937& random() { return random_; }

 private:
  std::filesystem::path database() const { return folder_ / "run.db"; }

  std::unique_ptr<ChildProcess> start(const std::string& name, std::vector<std::string> command) {
    command.insert(command.begin(), IVFM_PROGRAM);
    command.insert(command.end(), {"--time-scale", std::to_string(kTimeScale)});
    return std::make_unique<ChildProcess>(name, command, folder_ / (name + ".log"),
                                          [](std::string_view) {});
  }

  ServerValue file_value() const {
    auto maps = std::make_shared<std::map<std::uint16_t, LayerMap>>();
    (*maps)[0] = load_merged_map(database());
    for (const TeamRobot* robot : robots_) {
      (*maps)[robot->id()] = load_robot_map(database(), robot->id());
    }
    return [maps](std::uint16_t robot, Layer layer, Cell cell) -> unsigned {
      return (*maps)[robot].value(layer, cell);
    };
  }

  ScratchFolder folder_;
  std::mt19937 random_{1};
  LinuxClock clock_{kTimeScale};
  // Free when asked for; nobody else takes them meanwhile, as the kernel gives out others first.
  std::string server_address_ = UdpListener("127.0.0.1:0").text();
  std::string radio_address_ = UdpListener("127.0.0.1:0").text();
  std::vector<std::unique_ptr<UdpSocket>> sockets_;
  std::vector<std::unique_ptr<TeamRobot>> members_;
  std::vector<TeamRobot*> robots_;
  std::unique_ptr<ChildProcess> server_, radio_;
};

TEST(NothingLost, WhenTheServersProcessIsKilledAgainAndAgain) {
  RealTeam team;
  for (int kill = 1; kill <= kKills; ++kill) {
    const std::uint64_t heard = team.received();
    ASSERT_TRUE(team.turn_until(true, [&] { return team.received() >= heard + 40; }));
    for (auto turns = team.random()() % 40; turns > 0; --turns) team.turn(true);
    team.kill_server();
    ASSERT_EQ(team.missing(), "") << "after kill " << kill;
    if (kill % 2 == 0) team.restart_robot(team.random()() % 3);
    for (auto turns = team.random()() % 100; turns > 0; --turns) team.turn(true);
    team.start_server();
  }
  team.end_faults();
  // Twice: a first time may be before the server has heard of all robots.
  std::string difference = "not compared";
  ASSERT_TRUE(team.turn_until(false, [&] {
    if (team.all_acknowledged()) difference = team.different();
    return difference.empty();
  })) << difference;
  EXPECT_TRUE(team.stop_server());
  EXPECT_EQ(team.different(), "");
}

}  // namespace
}  // namespace ivfm::host

#include "host/demo/fleet.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/wait.h>

#include <fstream>
#include <thread>

namespace ivfm::host {
namespace {

using std::chrono::milliseconds;
using testing::HasSubstr;

TEST(AgentReport, TakesTelemetryAndIgnoresEverythingElse) {
  AgentReport report;
  report.take(R"({"state":"exploring","travelled_m":3.5,"actions":7,"decision_us":8000,)"
              R"("radio":{"bytes_sent":100,"bytes_received":50,"retransmissions":1},)"
              R"("lidar":{"scans":20,"resyncs":2},"can":{"frames_received":900}})",
              4);
  report.take("ivfm-agent: robot 1 runs", 4);
  report.take("", 4);
  report.take("{\"state\":", 4);
  report.take("[1]", 4);
  report.take(R"({"travelled_m":"far"})", 4);
  EXPECT_EQ(report.state, "exploring");
  EXPECT_DOUBLE_EQ(report.driven_m, 3.5);
  EXPECT_EQ(report.actions, 7u);
  EXPECT_DOUBLE_EQ(report.decision_ms, 2);  // 8 ms at four times real time
  EXPECT_EQ(report.bytes_sent, 100u);
  EXPECT_EQ(report.scans, 20u);
  EXPECT_EQ(report.can_frames, 900u);
  report.take(R"({"decision_us":4000})", 4);
  EXPECT_DOUBLE_EQ(report.decision_ms, 1);
  EXPECT_DOUBLE_EQ(report.slowest_decision_ms, 2);
}

// Fleets of shell scripts that behave like our programs.
class FleetTest : public testing::Test {
 protected:
  FleetTest() {
    std::string pattern = (std::filesystem::temp_directory_path() / "ivfm_fleet_XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
    prctl(PR_SET_CHILD_SUBREAPER, 1);
    script("ivfm", R"(echo $$ >> "$(dirname "$0")/pids"
case "$1" in
canbus) echo "CAN bus: connect with --can socketcand:127.0.0.1:1234/BUS" ;;
sim) echo "robot 1: --lidar L1 --can C1 --start 1,2,3"
     echo "robot 2: --lidar L2 --can C2 --start 4,5,6"
     echo "simulation ready"
     echo "collision: robot 2 at 0,0 after 1 s" ;;
radio) echo "radio on 127.0.0.1:4323, to 127.0.0.1:4321" ;;
serve)
  echo "listening on 127.0.0.1:4321, writing run.db"
  echo "live page http://127.0.0.1:4322/#token=secret" ;;
esac
trap 'exit 0' TERM
while :; do sleep 0.02; done)");
    script("agent", R"(echo $$ >> "$(dirname "$0")/pids"
echo "$@"
echo "ivfm-agent: robot N runs"
echo '{"state":"exploring","travelled_m":1.25}'
trap 'exit 0' TERM
while :; do sleep 0.02; done)");
  }
  ~FleetTest() override { std::filesystem::remove_all(folder_); }

  void script(const std::string& name, const std::string& body) {
    std::ofstream(folder_ / name) << "#!/bin/sh\n" << body << '\n';
    std::filesystem::permissions(folder_ / name, std::filesystem::perms::owner_all);
  }

  FleetOptions options() const {
    FleetOptions options;
    options.ivfm = folder_ / "ivfm";
    options.agent = folder_ / "agent";
    options.folder = folder_;
    options.agent_arguments = {"--profile", "robot"};
    return options;
  }

  std::string read(const std::filesystem::path& name) const {
    std::ifstream in(folder_ / name);
    return {std::istreambuf_iterator<char>(in), {}};
  }

  // How many of the started processes there are still.
  int survivors() const {
    std::ifstream in(folder_ / "pids");
    int alive = 0;
    for (pid_t pid; in >> pid;) {
      waitpid(pid, nullptr, WNOHANG);
      if (kill(pid, 0) == 0) ++alive;
    }
    return alive;
  }

  std::filesystem::path folder_;
  std::atomic<bool> interrupted_{false};
};

TEST_F(FleetTest, StartsEachWithWhatTheOthersSaidAndStopsAll) {
  Fleet fleet(options(), interrupted_);
  fleet.start();
  for (int i = 0; i < 500 && fleet.agents()[1].driven_m == 0; ++i) fleet.wait(milliseconds(20));
  EXPECT_DOUBLE_EQ(fleet.agents()[1].driven_m, 1.25);
  EXPECT_EQ(fleet.collisions(), 1);
  EXPECT_EQ(survivors(), 5);
  EXPECT_TRUE(fleet.stop()) << fleet.failure();
  EXPECT_EQ(survivors(), 0);
  EXPECT_THAT(read("logs/agent2.log"),
              HasSubstr("--lidar L2 --can C2 --start 4,5,6 --server 127.0.0.1:4321 --robot-id 2"));
  EXPECT_THAT(read("logs/agent2.log"), HasSubstr("--profile robot"));
}

TEST_F(FleetTest, RobotsJoinLateLeaveCrashAndComeBack) {
  FleetOptions late = options();
  late.late = {2};
  late.radio = "drop=0.3";
  Fleet fleet(late, interrupted_);
  const auto wait_for = [&fleet](const auto& condition) {
    for (int i = 0; i < 500 && !condition(); ++i) fleet.wait(milliseconds(20));
    return condition();
  };
  const AgentReport &first = fleet.agents()[0], &second = fleet.agents()[1];
  fleet.start();
  EXPECT_EQ(survivors(), 5);  // three services, the radio and a robot
  EXPECT_EQ(second.state, "not there");
  fleet.start_agent(2);
  ASSERT_TRUE(wait_for([&] { return second.driven_m > 0; }));
  fleet.dismiss_agent(1);
  ASSERT_TRUE(wait_for([&] { return !first.at_work; }));
  EXPECT_EQ(first.state, "left");
  fleet.kill_agent(2);
  EXPECT_EQ(second.state, "crashed");
  EXPECT_EQ(survivors(), 4);
  fleet.start_agent(2, "7,8,9");
  ASSERT_TRUE(wait_for([&] { return second.driven_m > 1.25; }));
  EXPECT_DOUBLE_EQ(second.driven_m, 2.5);  // in both its lives
  EXPECT_EQ(second.starts, 2);
  EXPECT_TRUE(fleet.stop()) << fleet.failure();
  EXPECT_EQ(survivors(), 0);
  EXPECT_THAT(read("logs/agent2.2.log"), HasSubstr("--start 7,8,9 --server 127.0.0.1:4323"));
}

TEST_F(FleetTest, AnInterruptionAtAnyMomentLeavesNoProcess) {
  for (const int after_ms : {0, 5, 20, 60}) {
    interrupted_ = false;
    std::thread other([&] {
      std::this_thread::sleep_for(milliseconds(after_ms));
      interrupted_ = true;
    });
    try {
      Fleet fleet(options(), interrupted_);
      fleet.start();
      for (;;) fleet.wait(milliseconds(10));
    } catch (const Interrupted&) {
    }
    other.join();
    EXPECT_EQ(survivors(), 0) << after_ms;
  }
}

TEST_F(FleetTest, AProcessThatEndsEarlyIsNamedWithItsLastWords) {
  script("agent", "echo 'ivfm-agent: cannot open the lidar' >&2; exit 1");
  Fleet fleet(options(), interrupted_);
  try {
    fleet.start();
    for (int i = 0; i < 500; ++i) fleet.wait(milliseconds(20));
    ADD_FAILURE();
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("agent"));
    EXPECT_THAT(error.what(), HasSubstr("exit code 1; its last words: ivfm-agent: cannot open"));
  }
}

TEST_F(FleetTest, AnAgentThatFailsAtTheEndIsReported) {
  script("agent",
         "trap 'echo map lost; exit 1' TERM; echo 'ivfm-agent: robot 1 runs'; "
         "while :; do sleep 0.02; done");
  Fleet fleet(options(), interrupted_);
  fleet.start();
  EXPECT_FALSE(fleet.stop());
  EXPECT_THAT(fleet.failure(), HasSubstr("exit code 1; its last words: map lost"));
  EXPECT_EQ(survivors(), 0);
}

}  // namespace
}  // namespace ivfm::host

#include "host/demo/child_process.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <thread>

namespace ivfm::host {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::ElementsAre;
using testing::HasSubstr;

class ChildProcessTest : public testing::Test {
 protected:
  ChildProcessTest() {
    std::string pattern = (std::filesystem::temp_directory_path() / "ivfm_child_XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
  }
  ~ChildProcessTest() override { std::filesystem::remove_all(folder_); }

  std::filesystem::path log() const { return folder_ / "child.log"; }

  static std::vector<std::string> shell(const std::string& script) {
    return {"/bin/sh", "-c", script};
  }

  // Waits for the end of a child; fails the test after ten seconds.
  static int wait_for_end(ChildProcess& child) {
    for (int i = 0; i < 500 && !child.exit_code(); ++i) poll_children({&child}, milliseconds(20));
    child.read_output();
    EXPECT_TRUE(child.exit_code().has_value());
    return child.exit_code().value_or(-1);
  }

  std::filesystem::path folder_;
};

TEST_F(ChildProcessTest, PassesOnLinesOfBothOutputsAndKeepsALog) {
  std::vector<std::string> lines;
  ChildProcess child("c", shell("echo one; echo two >&2; printf three; exit 3"), log(),
                     [&](std::string_view line) { lines.emplace_back(line); });
  EXPECT_EQ(wait_for_end(child), 3);
  EXPECT_THAT(lines, ElementsAre("one", "two"));
  EXPECT_EQ(child.last_line(), "two");
  std::ifstream in(log());
  EXPECT_EQ(std::string(std::istreambuf_iterator<char>(in), {}), "one\ntwo\nthree");
}

TEST_F(ChildProcessTest, AProgramThatIsNotThereIsAClearError) {
  try {
    ChildProcess child("c", {"/nowhere/program"}, log(), nullptr);
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("/nowhere/program cannot be started: No such file"));
  }
  EXPECT_THROW(ChildProcess("c", {"/bin/true"}, "/nowhere/log", nullptr), std::runtime_error);
}

TEST_F(ChildProcessTest, StoppingLetsTheChildCleanUp) {
  bool ready = false, cleaned = false;
  ChildProcess child("c",
                     shell("trap 'echo cleaned; exit 0' TERM; echo ready; "
                           "while :; do sleep 0.05; done"),
                     log(), [&](std::string_view line) {
                       ready |= line == "ready";
                       cleaned |= line == "cleaned";
                     });
  for (int i = 0; i < 500 && !ready; ++i) poll_children({&child}, milliseconds(20));
  ASSERT_TRUE(ready);
  EXPECT_TRUE(stop_children({&child}, seconds(10)));
  EXPECT_TRUE(cleaned);
}

TEST_F(ChildProcessTest, AChildThatIgnoresTheRequestIsKilled) {
  bool ready = false;
  ChildProcess child("c", shell("trap '' TERM; echo ready; while :; do sleep 0.05; done"), log(),
                     [&](std::string_view) { ready = true; });
  for (int i = 0; i < 500 && !ready; ++i) poll_children({&child}, milliseconds(20));
  EXPECT_FALSE(stop_children({&child}, milliseconds(100)));
  EXPECT_EQ(child.exit_code(), 128 + SIGKILL);
}

// True once `pid` has ended; this process must be its reaper. Waits at most ten seconds.
bool has_ended(pid_t pid) {
  for (int i = 0; i < 1000; ++i) {
    if (waitpid(pid, nullptr, WNOHANG) == pid || kill(pid, 0) != 0) return true;
    std::this_thread::sleep_for(milliseconds(10));
  }
  return false;
}

TEST_F(ChildProcessTest, DestructionEndsTheChildAndItsOwnChildren) {
  prctl(PR_SET_CHILD_SUBREAPER, 1);
  pid_t grandchild = 0;
  {
    ChildProcess child("c", shell("sleep 1000 & echo $!; wait"), log(),
                       [&](std::string_view line) { grandchild = std::stoi(std::string(line)); });
    for (int i = 0; i < 500 && !grandchild; ++i) poll_children({&child}, milliseconds(20));
    ASSERT_GT(grandchild, 0);
  }
  EXPECT_TRUE(has_ended(grandchild));
}

TEST_F(ChildProcessTest, AKilledParentLeavesNoChildBehind) {
  prctl(PR_SET_CHILD_SUBREAPER, 1);
  std::array<int, 2> ends{};
  ASSERT_EQ(pipe(ends.data()), 0);
  const pid_t parent = fork();
  if (parent == 0) {
    ChildProcess child("c", {"/bin/sleep", "1000"}, log(), nullptr);
    const pid_t pid = child.pid();
    if (write(ends[1], &pid, sizeof pid) != sizeof pid) _exit(1);
    for (;;) pause();
  }
  pid_t child = 0;
  ASSERT_EQ(read(ends[0], &child, sizeof child), static_cast<ssize_t>(sizeof child));
  kill(parent, SIGKILL);
  waitpid(parent, nullptr, 0);
  EXPECT_TRUE(has_ended(child));
  close(ends[0]);
  close(ends[1]);
}

}  // namespace
}  // namespace ivfm::host

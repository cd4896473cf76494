// Many seeded fault schedules, several at once. Names each that loses something and goes on;
// `--first N --schedules 1` runs one of them alone.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <mutex>
#include <thread>
#include <vector>

#include "host/cli/progress_line.h"
#include "tests/nothing_lost/simulated_team.h"

namespace ivfm::host {
namespace {

struct SoakOptions {
  std::uint32_t first = 1;
  std::uint32_t schedules = 1000;
  unsigned jobs = std::max(1u, std::thread::hardware_concurrency());
  ScheduleOptions schedule;
};

class Soak {
 public:
  explicit Soak(const SoakOptions& options) : options_(options), next_(options.first) {}

  // True when nothing was lost.
  bool run() {
    std::vector<std::thread> threads;
    for (unsigned i = 0; i < options_.jobs; ++i) threads.emplace_back([this] { work(); });
    for (std::thread& thread : threads) thread.join();
    const auto number = [](std::uint64_t value) { return static_cast<unsigned long long>(value); };
    std::printf(
        "%llu schedules, %llu lost something; %llu datagrams, %llu lost, %llu duplicated, "
        "%llu spoiled; %llu kills of servers, %llu of robots; %llu cells checked\n",
        number(done_), number(failures_), number(radio_.sent), number(radio_.lost),
        number(radio_.duplicated), number(radio_.spoiled), number(server_kills_),
        number(robot_kills_), number(cells_));
    return failures_ == 0;
  }

 private:
  void work() {
    for (std::uint32_t seed = next_++; seed - options_.first < options_.schedules; seed = next_++) {
      take(SimulatedTeam(draw_schedule(seed, options_.schedule)).run());
    }
  }

  void take(const ScheduleReport& report) {
    const std::lock_guard lock(mutex_);
    ++done_;
    radio_ += report.radio;
    server_kills_ += report.server_kills;
    robot_kills_ += report.robot_kills;
    cells_ += report.cells_checked;
    progress_(done_);
    if (report.failure.empty()) return;
    ++failures_;
    std::printf("%s\n", report.failure.c_str());
    std::fflush(stdout);
  }

  SoakOptions options_;
  std::atomic<std::uint32_t> next_;
  std::mutex mutex_;
  ProgressLine progress_{options_.schedules, "schedules"};
  std::uint64_t done_ = 0, failures_ = 0;
  RadioCounters radio_;
  std::uint64_t server_kills_ = 0, robot_kills_ = 0, cells_ = 0;
};

}  // namespace
}  // namespace ivfm::host

int main(int argc, char** argv) {
  ivfm::host::SoakOptions options;
  CLI::App app{"Map updates through many bad radios: is anything ever lost?"};
  app.add_option("--first", options.first, "seed of the first schedule")->capture_default_str();
  app.add_option("--schedules", options.schedules, "how many")->capture_default_str();
  app.add_option("--jobs", options.jobs, "at a time")->check(CLI::Range(1, 256));
  app.add_flag("!--spare-robots", options.schedule.kill_robots, "kill only the server");
  app.footer("Example: nothing_lost_soak --first 17 --schedules 1");
  CLI11_PARSE(app, argc, argv);
  try {
    return ivfm::host::Soak(options).run() ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "nothing_lost_soak: %s\n", error.what());
    return 1;
  }
}

// Robots that are carried away or whose wheels slip, in a building that they explore: each notices
// it, paints nothing more, stands and looks around, and finds its place again or says that it
// cannot. In simulated time. IVFM_RECOVERY_SEEDS=4-9 plays others.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <numbers>
#include <string>
#include <tuple>

#include "host/environment/random.h"
#include "host/simulator/world_catalog.h"
#include "tests/integration/simulated_team.h"

namespace ivfm {
namespace {

enum class Mishap { kNear, kKnown, kAnywhere, kTurned, kSpin, kOneSlips, kHalfSlip };
constexpr std::array kMishaps{Mishap::kNear, Mishap::kKnown,    Mishap::kAnywhere, Mishap::kTurned,
                              Mishap::kSpin, Mishap::kOneSlips, Mishap::kHalfSlip};

const char* name_of(Mishap mishap) {
  switch (mishap) {
    case Mishap::kNear: return "carried up to 1.5 m";
    case Mishap::kKnown: return "carried to a place it knows";
    case Mishap::kAnywhere: return "carried anywhere";
    case Mishap::kTurned: return "turned on the spot";
    case Mishap::kSpin: return "wheels spin for 5 s";
    case Mishap::kOneSlips: return "a wheel slips for 5 s";
    case Mishap::kHalfSlip: return "both wheels slip for 5 s";
  }
  return "";
}

struct Outcome {
  int runs = 0;
  int right = 0;        // it knows where it is, 90 s later
  int lost = 0;         // it says that it does not
  int wrong = 0;        // it believes to be elsewhere
  int wrong_finds = 0;  // times that it took a wrong place for its own
  int painted = 0;      // revolutions painted at a wrong place

  void operator+=(const Outcome& o) {
    runs += o.runs, right += o.right, lost += o.lost, wrong += o.wrong;
    wrong_finds += o.wrong_finds, painted += o.painted;
  }
  void print(const char* name) const {
    std::printf("%-28s  %4d  %5d  %4d  %5d  %11d  %13d\n", name, runs, right, lost, wrong,
                wrong_finds, painted);
  }
};

using Case = std::tuple<Mishap, const char*, int>;  // in which world, seed

class Recovery : public SimulatedTeam, public testing::WithParamInterface<Case> {
 protected:
  static constexpr TimeUs kSlipUs = 5 * kSecondUs;
  static constexpr TimeUs kAfterUs = 90 * kSecondUs;
  // Farther off than this a robot is at a wrong place.
  static constexpr double kOffM = 0.5, kOffDeg = 10;

  static void TearDownTestSuite() {
    std::printf("%-28s  %4s  %5s  %4s  %5s  %11s  %13s\n", "", "runs", "right", "lost", "wrong",
                "wrong finds", "painted wrong");
    Outcome all;
    for (const Mishap mishap : kMishaps) {
      const Outcome& outcome = outcomes_[static_cast<std::size_t>(mishap)];
      outcome.print(name_of(mishap));
      all += outcome;
    }
    all.print("all");
  }

  // Drives 5 m to 15 m, then it happens.
  Outcome play(const std::string& world, Mishap mishap, std::uint64_t seed) {
    Outcome outcome;
    host::Random random(seed, 99);
    begin(world, seed);
    const double metres = random.between(500, 1500) / 100.0;
    const TimeUs limit_us = now_us_ + 300 * kSecondUs;
    while (robots_[0]->body().travelled_m() < metres && now_us_ < limit_us) tick();
    const double before_m = error_m(0);
    befall(mishap, random);
    outcome.runs = 1;
    const TimeUs begun_us = now_us_;
    std::uint32_t fused = agent().progress().scans_fused;
    for (bool was_lost = false; now_us_ < begun_us + kAfterUs;) {
      tick();
      if (now_us_ == begun_us + kSlipUs) robots_[0]->set_grip(1, 1);
      outcome.wrong_finds += was_lost && !is_lost() && is_off() ? 1 : 0;
      outcome.painted += agent().progress().scans_fused != fused && is_off() ? 1 : 0;
      fused = agent().progress().scans_fused;
      was_lost = is_lost();
    }
    if (!is_lost() && is_off()) {
      std::printf("%s %d, %s: %.2f m and %.0f degrees off, %.2f m before\n", world.c_str(),
                  static_cast<int>(seed), name_of(mishap), error_m(0), error_deg(0), before_m);
    }
    ++(is_lost() ? outcome.lost : is_off() ? outcome.wrong : outcome.right);
    EXPECT_TRUE(!is_lost() || agent().state() == RobotState::kFault);
    return outcome;
  }

  static inline std::array<Outcome, kMishaps.size()> outcomes_;

 private:
  Agent& agent() { return robots_[0]->agent(); }
  bool is_lost() { return agent().localization().lost(); }
  bool is_off() { return error_m(0) > kOffM || error_deg(0) > kOffDeg; }

  void begin(const std::string& world, std::uint64_t seed) {
    host::WorldRequest request;
    request.name = world;
    request.robots = 1;
    request.seed = seed;
    request.random_starts = world == "corridor";
    const host::PreparedWorld prepared = host::prepare_world(request);
    world_ = std::make_shared<host::World>(prepared.world);
    AgentConfig config = make_agent_config({}, RobotProfile::kCellUm, 1);
    config.start = prepared.starts[0];
    add_robot(config, prepared.starts[0], "turtlebot", replay::ProfileId::kRobot);
  }
  void befall(Mishap mishap, host::Random& random) {
    replay::SimulatedRobot& robot = *robots_[0];
    switch (mishap) {
      case Mishap::kNear: robot.carry_to(somewhere(0.3, 1.5, 60, true, random)); break;
      case Mishap::kKnown: robot.carry_to(somewhere(2, 60, 180, true, random)); break;
      case Mishap::kAnywhere: robot.carry_to(somewhere(2, 60, 180, false, random)); break;
      case Mishap::kTurned: {
        host::TruePose pose = robot.body().pose();
        pose.heading_rad += random.between(20, 340) * std::numbers::pi / 180;
        robot.carry_to(pose);
        break;
      }
      case Mishap::kSpin: robot.set_grip(0, 0); break;
      case Mishap::kOneSlips: robot.set_grip(0.2, 1); break;
      case Mishap::kHalfSlip: robot.set_grip(0.5, 0.5); break;
    }
  }
  // Between two distances from where the robot is, and turned at most so far from its heading.
  host::TruePose somewhere(double least_m, double most_m, double turn_deg, bool known,
                           host::Random& random) {
    const host::TruePose from = robots_[0]->body().pose();
    const ExplorationMap& map = agent().explorer().map();
    const auto share = [&] { return random.between(-10'000, 10'000) / 10'000.0; };
    for (int i = 0; i < 100'000; ++i) {
      const host::TruePose to{from.x_m + most_m * share(), from.y_m + most_m * share(),
                              from.heading_rad + turn_deg * share() * std::numbers::pi / 180};
      const double distance_m = std::hypot(to.x_m - from.x_m, to.y_m - from.y_m);
      if (distance_m < least_m || distance_m > most_m) continue;
      if (host::disc_touches_obstacle(*world_, to.x_m, to.y_m, 0.2)) continue;
      const Cell c = map.frame().cell_at({static_cast<std::int32_t>(std::lround(to.x_m * 1e6)),
                                          static_cast<std::int32_t>(std::lround(to.y_m * 1e6))});
      if (!known || map.is_known_free(c)) return to;
    }
    ADD_FAILURE() << "there is no such place";
    return from;
  }
};

// The seeds to play, FIRST-LAST in IVFM_RECOVERY_SEEDS; by default only the first.
auto seeds() {
  int first = 1, last = 1;
  if (const char* const wanted = std::getenv("IVFM_RECOVERY_SEEDS")) {
    if (std::sscanf(wanted, "%d-%d", &first, &last) != 2 || first < 1 || last < first) {
      std::fprintf(stderr, "IVFM_RECOVERY_SEEDS is FIRST-LAST, such as 4-9, not %s\n", wanted);
      std::exit(2);
    }
  }
  return testing::Range(first, last + 1);
}

TEST_P(Recovery, TakesNoWrongPlaceForItsOwn) {
  const auto [mishap, world, seed] = GetParam();
  const Outcome outcome = play(world, mishap, static_cast<std::uint64_t>(seed));
  outcomes_[static_cast<std::size_t>(mishap)] += outcome;
  EXPECT_EQ(outcome.wrong_finds, 0);
  EXPECT_EQ(outcome.wrong, 0);
  EXPECT_LE(outcome.painted, 10);
}

INSTANTIATE_TEST_SUITE_P(, Recovery,
                         testing::Combine(testing::ValuesIn(kMishaps),
                                          testing::Values("building", "corridor", "malaga"),
                                          seeds()));

}  // namespace
}  // namespace ivfm

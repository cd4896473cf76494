#include "host/trainer/replay_buffer.h"

#include <gtest/gtest.h>

#include <set>
#include <sstream>
#include <stdexcept>

#include "host/trainer/symmetry.h"

namespace ivfm::host {
namespace {

// A state that names every cell: channel 0 holds the cell's number, channel 1 its complement.
Observation numbered() {
  Observation o;
  for (int i = 0; i < kActions; ++i) {
    o.state[static_cast<std::size_t>(i)] = static_cast<std::uint16_t>(i);
    o.state[static_cast<std::size_t>(kActions + i)] = static_cast<std::uint16_t>(5000 - i);
    if (i % 7 == 0) o.reachable.set(i);
  }
  return o;
}

Observation filled(std::uint16_t value) {
  Observation o;
  o.state.fill(value);
  return o;
}

TEST(Symmetry, MovesStateMaskAndActionTogether) {
  const Observation o = numbered();
  for (int s = 0; s < kSymmetries; ++s) {
    const State state = transformed(s, o.state);
    const ActionMask mask = transformed(s, o.reachable);
    for (int a = 0; a < kActions; ++a) {
      const int to = transformed_action(s, a);
      EXPECT_EQ(state[static_cast<std::size_t>(to)], a);
      EXPECT_EQ(state[static_cast<std::size_t>(kActions + to)], 5000 - a);
      EXPECT_EQ(mask.test(to), o.reachable.test(a));
    }
  }
}

TEST(Symmetry, OfTheSouthWestCornerAreTheFourCornersTwice) {
  std::multiset<int> corners;
  for (int s = 0; s < kSymmetries; ++s) corners.insert(transformed_action(s, 0));
  EXPECT_EQ(corners, (std::multiset<int>{0, 0, 31, 31, 992, 992, 1023, 1023}));
}

TEST(Symmetry, ZeroIsTheIdentity) {
  EXPECT_EQ(transformed(0, numbered().state), numbered().state);
  EXPECT_EQ(transformed_action(0, 77), 77);
}

TEST(ActionMask, CountsWhatWasSet) {
  ActionMask mask;
  EXPECT_FALSE(mask.any());
  mask.set(0);
  mask.set(1023);
  mask.set(1023);
  EXPECT_TRUE(mask.any());
  EXPECT_EQ(mask.count(), 2);
}

TEST(ReplayBuffer, ForgetsTheOldestObservationsAndTheTransitionsThatNeedThem) {
  ReplayBuffer replay(3, 10);
  for (std::uint16_t i = 0; i < 5; ++i) {
    const ObservationId id = replay.add(filled(i));
    EXPECT_EQ(id, i);
    if (id > 0) replay.add(Transition{id - 1, id, i, 1.0f, 0.9f});
  }
  EXPECT_FALSE(replay.holds(1));
  EXPECT_TRUE(replay.holds(2));
  EXPECT_EQ(replay.observation(4).state[0], 4);
  ResumableRandom random(1);
  std::set<ObservationId> seen;
  for (int i = 0; i < 200; ++i) seen.insert(replay.sample(random).from);
  EXPECT_EQ(seen, (std::set<ObservationId>{2, 3}));
}

TEST(ReplayBuffer, DrawsWhatWasTriedInTheSameStateTogether) {
  ReplayBuffer replay(10, 10);
  const ObservationId a = replay.add(filled(1)), b = replay.add(filled(2));
  replay.add(Transition{a, kNoObservation, 1, 0, 0});
  for (std::int32_t k = 0; k < 4; ++k) replay.add(Transition{b, kNoObservation, 10 + k, 0, 0});
  ResumableRandom random(3);
  std::set<std::int32_t> tried;
  for (int i = 0; i < 200; ++i) {
    const auto siblings = replay.sample_siblings(3, random);
    ASSERT_EQ(siblings.size(), siblings.front().from == a ? 1u : 3u);
    for (const Transition& t : siblings) {
      EXPECT_EQ(t.from, siblings.front().from);
      tried.insert(t.action);
    }
  }
  EXPECT_EQ(tried, (std::set<std::int32_t>{1, 10, 11, 12, 13}));
}

TEST(ReplayBuffer, ComesBackFromAFileWithTheSameSamples) {
  ReplayBuffer replay(4, 4);
  for (std::uint16_t i = 0; i < 6; ++i) {
    const ObservationId id = replay.add(filled(i));
    replay.add(Transition{id, kNoObservation, i, static_cast<float>(i), 0});
  }
  std::stringstream file;
  replay.save(file);
  ReplayBuffer copy(4, 4);
  copy.load(file);
  ResumableRandom a(7), b(7);
  for (int i = 0; i < 50; ++i) {
    const Transition& x = replay.sample(a);
    const Transition& y = copy.sample(b);
    EXPECT_EQ(x.from, y.from);
    EXPECT_EQ(x.reward, y.reward);
    EXPECT_EQ(replay.observation(x.from).state, copy.observation(y.from).state);
  }
}

TEST(ReplayBuffer, RefusesAFileOfAnotherSizeOrCutShort) {
  ReplayBuffer replay(4, 4);
  replay.add(filled(1));
  std::stringstream file;
  replay.save(file);
  ReplayBuffer other(5, 4);
  EXPECT_THROW(other.load(file), std::runtime_error);
  std::stringstream cut(file.str().substr(0, 100));
  EXPECT_THROW(replay.load(cut), std::runtime_error);
  std::stringstream empty;
  EXPECT_THROW(replay.load(empty), std::runtime_error);
}

}  // namespace
}  // namespace ivfm::host

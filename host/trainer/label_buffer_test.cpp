#include "host/trainer/label_buffer.h"

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

LabelledState labelled(std::int32_t action, float value) {
  LabelledState state;
  state.observation.state.fill(static_cast<std::uint16_t>(action));
  state.actions = {action, action + 1};
  state.values = {value, value + 1};
  return state;
}

TEST(LabelBuffer, ForgetsTheOldest) {
  LabelBuffer buffer(3);
  for (int i = 0; i < 5; ++i) buffer.add(labelled(i, 0));
  ASSERT_EQ(buffer.size(), 3u);
  std::set<int> held;
  for (std::size_t i = 0; i < 3; ++i) held.insert(buffer[i].actions[0]);
  EXPECT_EQ(held, (std::set<int>{2, 3, 4}));
  buffer.clear();
  EXPECT_EQ(buffer.size(), 0u);
}

TEST(LabelBuffer, ComesBackFromAFileAndGoesOnAlike) {
  LabelBuffer buffer(4), copy(4);
  for (int i = 0; i < 6; ++i) buffer.add(labelled(i, 0.5f * static_cast<float>(i)));
  std::stringstream file;
  buffer.save(file);
  copy.load(file);
  buffer.add(labelled(9, 9));
  copy.add(labelled(9, 9));
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(copy[i].observation.state, buffer[i].observation.state);
    EXPECT_EQ(copy[i].actions, buffer[i].actions);
    EXPECT_EQ(copy[i].values, buffer[i].values);
  }
}

TEST(LabelBuffer, RefusesAFileOfAnotherSizeOrCutShort) {
  LabelBuffer buffer(4);
  buffer.add(labelled(1, 1));
  std::stringstream file;
  buffer.save(file);
  LabelBuffer other(5);
  EXPECT_THROW(other.load(file), std::runtime_error);
  std::stringstream cut(file.str().substr(0, 100));
  EXPECT_THROW(buffer.load(cut), std::runtime_error);
}

}  // namespace
}  // namespace ivfm::host

#include "host/quantizer/recorded_states.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <stdexcept>

#include "host/quantizer/float_q_function.h"
#include "host/quantizer/quantizer.h"

namespace ivfm::host {
namespace {

class RecordedStatesTest : public testing::Test {
 protected:
  FloatNetwork network_ = make_random_network(4);
  FloatQFunction q_{network_};
};

TEST_F(RecordedStatesTest, AreAsManyAsWantedEachWithAGoalAndTheSameAgain) {
  const RecordedStates recorded = record_states(q_, 13, 5);
  ASSERT_EQ(recorded.states.size(), 13u * 2 * kPolicyGridSize);
  ASSERT_EQ(recorded.masks.size(), 13u * kPolicyGridSize);
  for (std::size_t i = 0; i < 13; ++i) {
    const auto mask = std::span(recorded.masks).subspan(i * kPolicyGridSize, kPolicyGridSize);
    EXPECT_GT(std::ranges::count(mask, 1), 0) << i;
  }
  FloatQFunction again(network_);
  EXPECT_EQ(record_states(again, 13, 5).states, recorded.states);
}

TEST_F(RecordedStatesTest, CompareLooksOnlyAtWhatCanBeAGoal) {
  const RecordedStates recorded = record_states(q_, 12, 6);
  const auto model = quantize(network_, recorded.states);
  // With one goal a state there is nothing to choose wrongly.
  std::vector<std::uint8_t> one_goal(recorded.masks.size(), 0);
  for (std::size_t i = 0; i < 12; ++i) one_goal[i * kPolicyGridSize + 77] = 1;
  const QuantizationReport forced = compare(network_, model, recorded.states, one_goal);
  EXPECT_EQ(forced.same_best, 1);
  EXPECT_EQ(forced.near_best_value, 1);
  EXPECT_EQ(forced.worst_loss, 0);
  const QuantizationReport free = compare(network_, model, recorded.states, recorded.masks);
  EXPECT_LE(free.same_best, free.near_best_value);
  EXPECT_LE(free.same_best, free.near_best);
  EXPECT_THROW(compare(network_, model, recorded.states, std::span(one_goal).first(5)),
               std::invalid_argument);
}

}  // namespace
}  // namespace ivfm::host

#include "host/environment/random.h"

#include <gtest/gtest.h>

#include <array>

namespace ivfm::host {
namespace {

// The reference outputs of SplitMix64 for seed 1234567 (Vigna, splitmix64.c; Rosetta Code).
TEST(Random, GivesTheReferenceSequenceOfSplitMix64) {
  Random random(1234567);
  EXPECT_EQ(random.next(), 6457827717110365317u);
  EXPECT_EQ(random.next(), 3203168211198807973u);
  EXPECT_EQ(random.next(), 9817491932198370423u);
}

TEST(Random, DrawsEveryValueBelowABoundAboutEquallyOften) {
  Random random(5);
  std::array<int, 7> counts{};
  for (int i = 0; i < 70'000; ++i) ++counts.at(random.below(7));
  for (const int count : counts) EXPECT_NEAR(count, 10'000, 500);  // 5 standard deviations
}

TEST(Random, StaysInsideAClosedRangeAndReachesItsEnds) {
  Random random(6);
  bool low = false, high = false;
  for (int i = 0; i < 1000; ++i) {
    const std::int32_t v = random.between(-2, 3);
    ASSERT_GE(v, -2);
    ASSERT_LE(v, 3);
    low |= v == -2;
    high |= v == 3;
  }
  EXPECT_TRUE(low && high);
  EXPECT_EQ(random.below(0), 0u);
  EXPECT_EQ(random.between(4, 4), 4);
}

TEST(Random, StreamsOfOneSeedDiffer) {
  EXPECT_NE(Random(1, 0).next(), Random(1, 1).next());
  EXPECT_NE(Random(1, 0).next(), Random(0, 1).next());
}

}  // namespace
}  // namespace ivfm::host

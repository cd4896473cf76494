#include "host/environment/network_state.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "host/environment/arena_worlds.h"
#include "host/environment/exploration_environment.h"

namespace ivfm::host {
namespace {

class NetworkStateTest : public testing::Test {
 protected:
  NetworkStateTest() {
    env_.reset(random_arena(ArenaKind::k1x, 1, 5));
    for (int i = 0; i < 6; ++i) env_.step_global(0);
    env_.observe(0);
  }
  std::vector<std::uint16_t> encode(StateKind kind) {
    std::vector<std::uint16_t> out(static_cast<std::size_t>(channels_of(kind)) * kPolicyGridSize);
    encode_network_state(kind, env_.explorer(0), env_.pose(0), out);
    return out;
  }
  const LocalState& state() { return env_.state(0); }

  ExplorationEnvironment env_{EnvironmentConfig::arena()};
};

TEST_F(NetworkStateTest, IvfmIsTheStateOnBoard) {
  const auto out = encode(StateKind::kIvfm);
  EXPECT_TRUE(std::equal(out.begin(), out.end(), state().channels.begin()));
}

TEST_F(NetworkStateTest, VfmCountsWhatTheMapHolds) {
  const auto out = encode(StateKind::kVfm);
  const ExplorationMap& map = env_.explorer(0).map();
  bool some_obstacle = false, some_visits = false;
  for (int i = 0; i < kPolicyGridSize; ++i) {
    int obstacles = 0, visits = 0;
    const CellRect block = state().grid.block(i);
    for (std::int32_t y = block.y; y < block.top(); ++y) {
      for (std::int32_t x = block.x; x < block.right(); ++x) {
        if (!map.frame().contains({x, y})) continue;
        obstacles += map.is_obstacle({x, y});
        const std::size_t at = map.frame().index_of({x, y});
        visits += std::min(16, map.layers().own_visits[at] + map.layers().peer_visits[at]);
      }
    }
    const auto cell = static_cast<std::size_t>(i);
    EXPECT_EQ(out[kPolicyGridSize + cell], obstacles * 49152 / block.area());
    EXPECT_EQ(out[2 * kPolicyGridSize + cell], visits * 3072 / block.area());
    EXPECT_EQ(out[3 * kPolicyGridSize + cell], state().path()[cell]);
    some_obstacle |= obstacles > 0;
    some_visits |= visits > 0;
  }
  EXPECT_TRUE(some_obstacle);
  EXPECT_TRUE(some_visits);
  EXPECT_EQ(out[16 * 32 + 16], 49152) << "the robot stands in the middle";
  EXPECT_EQ(out[0], 0) << "and not in the corner";
}

TEST_F(NetworkStateTest, FoldedTellsNearFromFarAndSeenFromUnseen) {
  const auto out = encode(StateKind::kFoldedIvfm);
  for (std::size_t a = 0; a < kPolicyGridSize; ++a) {
    for (std::size_t b = 0; b < kPolicyGridSize; b += 37) {
      const int pa = state().path()[a], pb = state().path()[b];
      if (pa == kPathUnreachable || pb == kPathUnreachable) continue;
      const int ia = state().ivfm()[a], ib = state().ivfm()[b];
      if (ia == ib && pa + 256 < pb) {
        EXPECT_GT(out[a], out[b]);
      }
      if (pa == pb && ia + 16 < ib) {
        EXPECT_LT(out[a], out[b]);
      }
    }
    EXPECT_LE(out[a], kIvfmBlocked);
    EXPECT_GE(out[a], kIvfmOfVisits[0]);
    if (state().path()[a] == kPathUnreachable) {
      EXPECT_EQ(out[a], state().ivfm()[a]);
    }
  }
}

}  // namespace
}  // namespace ivfm::host

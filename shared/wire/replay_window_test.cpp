#include "shared/wire/replay_window.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

namespace ivfm {
namespace {

TEST(ReplayWindow, TakesEachNumberOnceInAnyOrder) {
  ReplayWindow window;
  EXPECT_FALSE(window.take(0));
  EXPECT_TRUE(window.take(3));
  EXPECT_TRUE(window.take(1));
  EXPECT_TRUE(window.take(2));
  for (const std::uint32_t sequence : {1u, 2u, 3u}) EXPECT_FALSE(window.take(sequence));
  EXPECT_EQ(window.newest(), 3u);
  EXPECT_EQ(window.earlier(), 3u);
}

TEST(ReplayWindow, WhatIsFartherBackThanItsBitsIsNeverTaken) {
  ReplayWindow window;
  EXPECT_TRUE(window.take(100));
  EXPECT_FALSE(window.take(35));
  EXPECT_TRUE(window.take(36));
  EXPECT_TRUE(window.take(0xffffffff));
  EXPECT_FALSE(window.take(100));
  EXPECT_TRUE(window.take(0xfffffff0));
}

TEST(ReplayWindow, AgreesWithASetOfNumbers) {
  std::mt19937 random(1);
  ReplayWindow window;
  std::set<std::uint32_t> taken;
  std::uint32_t newest = 0;
  for (unsigned i = 0; i < 100000; ++i) {
    const auto sequence = static_cast<std::uint32_t>(1 + i / 10 + random() % 100);
    const bool is_new = !taken.contains(sequence) && (sequence > newest || newest - sequence <= 64);
    ASSERT_EQ(window.take(sequence), is_new) << sequence;
    if (is_new) taken.insert(sequence);
    newest = std::max(newest, sequence);
  }
}

}  // namespace
}  // namespace ivfm

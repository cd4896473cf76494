#include "firmware/planning/teammates.h"

#include <gtest/gtest.h>

namespace ivfm {
namespace {

constexpr std::int32_t kCell = path::kStraight;

TEST(Teammates, ALoneRobotTakesEverything) {
  EXPECT_EQ(Teammates().share_left({500, -70}, 60'000, 0), Teammates::kWhole);
}

TEST(Teammates, WhatOneIsNearerToCountsLess) {
  Teammates teammates;
  teammates.set(std::array{Cell{10, 0}, Cell{0, 30}});
  EXPECT_EQ(teammates.share_left({20, 0}, 10 * kCell, 5 * kCell), Teammates::kWhole)
      << "as near as this robot";
  EXPECT_EQ(teammates.share_left({20, 0}, 25 * kCell, 5 * kCell), Teammates::kWhole / 2);
  EXPECT_EQ(teammates.share_left({10, 0}, 15 * kCell, 5 * kCell), Teammates::kWhole / 4)
      << "it stands there";
  EXPECT_EQ(teammates.share_left({5, 33}, 2 * kCell + 3 * path::kDiagonal, 0), Teammates::kWhole);
  EXPECT_LT(teammates.share_left({5, 33}, 3 * kCell + 3 * path::kDiagonal, 0), Teammates::kWhole);
}

TEST(Teammates, OfTooManyTheFirstCount) {
  Teammates teammates;
  std::array<Cell, Teammates::kMost + 1> places;
  places.fill({1'000, 0});
  places.back() = {0, 0};
  teammates.set(places);
  EXPECT_EQ(teammates.share_left({0, 0}, kCell, kCell), Teammates::kWhole);
  teammates.set({});
  EXPECT_EQ(teammates.share_left({1'000, 0}, kCell, kCell), Teammates::kWhole);
}

}  // namespace
}  // namespace ivfm

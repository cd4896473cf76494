#include "host/simulator/doors.h"

#include <gtest/gtest.h>

#include <array>
#include <stdexcept>

namespace ivfm::host {
namespace {

constexpr TimeUs kSecond = 1'000'000;

// 10 m by 10 m of free floor in cells of 0.1 m, but a wall at x = 5 m with a gap from y = 4 to 5 m.
World two_rooms() {
  World world{"two rooms", 100'000, 100, 100, {0, 0}, std::vector<std::uint8_t>(10'000, 0)};
  for (std::size_t y = 0; y < 100; ++y) world.occupied[y * 100 + 50] = y < 40 || y >= 50 ? 1 : 0;
  return world;
}

int closed_cells(const World& world) {
  int count = 0;
  for (std::size_t y = 40; y < 50; ++y) count += world.occupied[y * 100 + 50];
  return count;
}

TEST(Doors, AreWrittenAsARectangleAndATime) {
  const Door door = parse_door("-3,1,-2.9,2@20s+1500ms");
  EXPECT_EQ(door.x0_m, -3);
  EXPECT_EQ(door.y1_m, 2);
  EXPECT_EQ(door.close_us, 20 * kSecond);
  EXPECT_EQ(door.open_us, 21'500'000u);
  EXPECT_EQ(parse_door("0,0,1,1@0s").open_us, UINT64_MAX);
  for (const char* wrong : {"", "1,2,3@4s", "0,0,1,1", "0,0,1,1@", "0,0,1,1@4", "1,0,0,1@4s",
                            "0,0,1,1@4s+", "0,0,1,1@4s 5", "a,0,1,1@4s"}) {
    EXPECT_THROW(parse_door(wrong), std::invalid_argument) << wrong;
  }
}

TEST(Doors, CloseAndOpenWhenItIsTime) {
  World world = two_rooms();
  Doors doors(world, {parse_door("4.5,3,5.5,6@2s+3s")});
  EXPECT_FALSE(doors.step(kSecond, world, {}, 0.1));
  EXPECT_TRUE(doors.step(2 * kSecond, world, {}, 0.1));
  EXPECT_EQ(closed_cells(world), 10);
  EXPECT_FALSE(doors.step(3 * kSecond, world, {}, 0.1));
  EXPECT_TRUE(doors.step(5 * kSecond, world, {}, 0.1));
  EXPECT_EQ(world.occupied, two_rooms().occupied) << "the wall beside it stays";
}

TEST(Doors, WaitWhileSomethingStandsInThem) {
  World world = two_rooms();
  Doors doors(world, {parse_door("5,4,5.1,5@0s")});
  const std::array body{TruePose{5.19, 4.5, 0}};
  EXPECT_FALSE(doors.step(0, world, body, 0.1));
  const std::array gone{TruePose{5.21, 4.5, 0}};
  EXPECT_TRUE(doors.step(kSecond, world, gone, 0.1));
  EXPECT_EQ(closed_cells(world), 10);
}

TEST(Doors, NeedFreeFloor) {
  EXPECT_THROW(Doors(two_rooms(), {parse_door("5,1,5.1,2@0s")}), std::invalid_argument);
  EXPECT_THROW(Doors(two_rooms(), {parse_door("50,1,51,2@0s")}), std::invalid_argument);
}

}  // namespace
}  // namespace ivfm::host

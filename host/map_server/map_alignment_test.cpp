#include "host/map_server/map_alignment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "host/map_server/frame_finder.h"
#include "tests/support/drawn_walls.h"

namespace ivfm::host {
namespace {

constexpr std::int32_t kCellUm = 50'000;
constexpr TimeUs kSecond = 1'000'000;

struct Region {
  double x0, y0, x1, y1;  // metres
  bool contains(double x, double y) const { return x >= x0 && x <= x1 && y >= y0 && y <= y1; }
};

double distance_m(const Wall& wall, double x, double y) {
  const double ex = wall.x1 - wall.x0, ey = wall.y1 - wall.y0;
  const double along = ((x - wall.x0) * ex + (y - wall.y0) * ey) / (ex * ex + ey * ey);
  const double t = std::clamp(along, 0.0, 1.0);
  return std::hypot(x - wall.x0 - t * ex, y - wall.y0 - t * ey);
}

// What somebody knows who has seen a part of the world; `frame`: T_world_map.
void draw(MapStore& store, const std::vector<Wall>& walls, const Region& region,
          const Pose& frame = {}) {
  const Pose back = relative_pose(frame, {});
  const GridFrame grid(kCellUm, {});
  std::vector<TileChange> changes;
  std::uint32_t sequence = 1;
  for (double y = region.y0; y <= region.y1; y += 0.02) {
    for (double x = region.x0; x <= region.x1; x += 0.02) {
      double nearest = std::numeric_limits<double>::max();
      for (const Wall& wall : walls) nearest = std::min(nearest, distance_m(wall, x, y));
      const auto um = [](double m) { return static_cast<std::int32_t>(std::lround(m * 1e6)); };
      const Cell c = grid.cell_at(transform(back, um(x), um(y)));
      const Layer layer = nearest < 0.025 ? Layer::kObstacles : Layer::kVisits;
      const std::uint8_t one = 1;
      store.merge(1, 1, ++sequence, layer, {c.x, c.y, 1, 1}, {&one, 1}, changes);
    }
  }
}

std::optional<MapMatch> match_of(const MapStore& team, const MapStore& apart) {
  MapAlignment alignment(team, apart, kCellUm);
  while (!alignment.step()) {
  }
  return alignment.match();
}

// A corridor along x with rooms of several widths on its north side.
const std::vector<Wall> kFloor{
    {0, 0, 18, 0},    {0, 0, 0, 6},     {18, 0, 18, 6},     {0, 6, 18, 6},     {0, 2, 2, 2},
    {2.9, 2, 4, 2},   {4, 2, 4, 6},     {4, 2, 5.5, 2},     {6.5, 2, 9, 2},    {9, 2, 9, 6},
    {9, 2, 9.3, 2},   {10.2, 2, 12, 2}, {12, 2, 12, 6},     {12, 2, 14, 2},    {15, 2, 18, 2},
    {7, 4.5, 8, 4.5}, {7, 4.5, 7, 5.2}, {10.5, 4, 10.5, 5}, {13, 3.2, 13.8, 4}};
const Pose kFrame{{7'000'000, -3'000'000}, BinaryAngle::from_degrees(137)};

TEST(MapAlignment, FindsHowTwoMapsOfABuildingLie) {
  MapStore team, apart;
  draw(team, kFloor, {-0.1, -0.1, 12.1, 6.1});
  draw(apart, kFloor, {4.5, -0.1, 18.1, 6.1}, kFrame);
  const auto match = match_of(team, apart);
  ASSERT_TRUE(match.has_value());
  const Point middle{9'000'000, 3'000'000};
  const Pose back = relative_pose(kFrame, {});
  const Point in_apart = transform(back, middle.x_um, middle.y_um);
  const Point found = transform(match->frame, in_apart.x_um, in_apart.y_um);
  EXPECT_LT(squared_distance_um2(found, middle), std::int64_t{30'000} * 30'000);
  EXPECT_NEAR((match->frame.heading - kFrame.heading).degrees(), 0, 0.5);
  EXPECT_GT(match->wall_m, 15);
}

TEST(MapAlignment, FindsNothingWhereTheMapsDoNotMeet) {
  MapStore team, apart;
  draw(team, kFloor, {-0.1, -0.1, 8.5, 6.1});
  draw(apart, kFloor, {9.5, -0.1, 18.1, 6.1}, kFrame);
  EXPECT_FALSE(match_of(team, apart).has_value());
}

TEST(MapAlignment, FindsNothingWithoutWalls) {
  MapStore team, apart;
  EXPECT_FALSE(match_of(team, apart).has_value());
  draw(team, kFloor, {-0.1, -0.1, 8.5, 6.1});
  EXPECT_FALSE(match_of(team, apart).has_value());
  EXPECT_FALSE(match_of(apart, team).has_value());
}

TEST(MapAlignment, FindsNothingAlongABareCorridor) {
  const std::vector<Wall> corridor{{-30, 0, 30, 0}, {-30, 2, 30, 2}};
  MapStore team, apart;
  draw(team, corridor, {-10, -0.1, 10, 2.1});
  draw(apart, corridor, {-6, -0.1, 14, 2.1}, kFrame);
  EXPECT_FALSE(match_of(team, apart).has_value());
}

TEST(MapAlignment, FindsNothingInASymmetricRoom) {
  const std::vector<Wall> room{{0, 0, 6, 0}, {6, 0, 6, 4}, {6, 4, 0, 4}, {0, 4, 0, 0}};
  MapStore team, apart;
  draw(team, room, {-0.1, -0.1, 6.1, 4.1});
  draw(apart, room, {-0.1, -0.1, 6.1, 4.1}, kFrame);
  EXPECT_FALSE(match_of(team, apart).has_value());
}

TEST(MapAlignment, FindsNothingBetweenPillarsThatStandAlike) {
  std::vector<Wall> pillars{{-30, 0, 30, 0}, {-30, 3, 30, 3}};
  for (int i = -10; i < 10; ++i) pillars.push_back({i * 2.0, 0, i * 2.0, 0.5});
  MapStore team, apart;
  draw(team, pillars, {-9, -0.1, 9, 3.1});
  draw(apart, pillars, {-3, -0.1, 11, 3.1}, kFrame);
  EXPECT_FALSE(match_of(team, apart).has_value());
}

// Two rooms of the same shape, 3 m by 2.6 m, in different surroundings.
std::vector<Wall> room_at(double x, double y) {
  return {{x, y, x + 3, y},
          {x, y, x, y + 2.6},
          {x, y + 2.6, x + 3, y + 2.6},
          {x + 3, y, x + 3, y + 1},
          {x + 3, y + 1.9, x + 3, y + 2.6},
          {x + 0.8, y, x + 0.8, y + 0.9}};
}

class FrameFinding : public testing::Test {
 protected:
  // All that is to be done now.
  std::optional<FrameFinder::Found> search() {
    std::optional<FrameFinder::Found> found;
    now_us_ += 6 * kSecond;
    for (int i = 0; i < 1000 && !found; ++i) found = finder_.step(team_, apart_, kCellUm, now_us_);
    return found;
  }
  FrameFinder finder_;
  MapStore team_;
  ApartMaps apart_;
  TimeUs now_us_ = 0;
};

TEST_F(FrameFinding, AFrameCountsOnceMoreWasSeenByBoth) {
  draw(team_, kFloor, {-0.1, -0.1, 12.1, 6.1});
  draw(apart_[7], kFloor, {4.5, -0.1, 8.5, 4}, kFrame);
  EXPECT_FALSE(search().has_value());
  EXPECT_FALSE(search().has_value()) << "nothing new was seen";
  draw(apart_[7], kFloor, {4.5, -0.1, 12.1, 4}, kFrame);
  std::optional<FrameFinder::Found> found = search();
  if (!found) {
    draw(apart_[7], kFloor, {4.5, -0.1, 12.1, 6.1}, kFrame);
    found = search();
  }
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(found->robot, 7);
  EXPECT_TRUE(is_near(found->match.frame, kFrame, 100'000, 182));
  EXPECT_FALSE(search().has_value()) << "once is enough";
}

TEST_F(FrameFinding, ARoomThatLooksLikeAnotherIsNotTakenForIt) {
  std::vector<Wall> walls = room_at(0, 0);
  for (const Wall& wall : room_at(20, 0)) walls.push_back(wall);
  walls.push_back({4.5, -4, 4.5, 6});
  walls.push_back({25.5, -4, 25.5, 0.5});
  walls.push_back({25.5, 0.5, 28, 0.5});
  draw(team_, walls, {-0.1, -3, 4.6, 5});
  draw(apart_[7], walls, {19.9, -0.1, 23.1, 2.7}, kFrame);
  EXPECT_FALSE(search().has_value()) << "it may well be the same room";
  draw(apart_[7], walls, {19.9, -3, 28, 5}, kFrame);
  EXPECT_FALSE(search().has_value());
}

}  // namespace
}  // namespace ivfm::host

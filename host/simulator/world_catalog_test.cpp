#include "host/simulator/world_catalog.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>

namespace ivfm::host {
namespace {

using testing::HasSubstr;

std::string error_of(const WorldRequest& request) {
  try {
    prepare_world(request);
  } catch (const std::exception& error) {
    return error.what();
  }
  return "no error";
}

WorldRequest request(const std::string& name, int robots) {
  WorldRequest r;
  r.name = name;
  r.robots = robots;
  return r;
}

TEST(WorldCatalog, EveryNameGivesAWorldWithRoomForTheRobots) {
  for (const char* name :
       {"1x", "2x", "divider", "divider-released", "building", "corridor", "malaga"}) {
    const PreparedWorld prepared = prepare_world(request(name, 3));
    EXPECT_EQ(prepared.world.name, name);
    EXPECT_EQ(prepared.starts.size(), 3u);
  }
}

TEST(WorldCatalog, TheSeedDrawsTheStartsInTheCorridorWhenAsked) {
  WorldRequest r = request("corridor", 2);
  const auto stated = prepare_world(r).starts;
  r.random_starts = true;
  const auto drawn = prepare_world(r).starts;
  EXPECT_NE(stated, drawn);
  r.seed = 2;
  EXPECT_NE(prepare_world(r).starts, drawn);
}

TEST(WorldCatalog, SaysWhatIsWrongWithNamesNumbersAndStarts) {
  EXPECT_THAT(error_of(request("moon", 1)), HasSubstr("'moon' is unknown: use 1x, 2x"));
  EXPECT_THAT(error_of(request("moon.yaml", 1)), HasSubstr("no such file"));
  EXPECT_THAT(error_of(request("corridor", 0)), HasSubstr("1 to 8"));
  WorldRequest r = request("corridor", 1);
  r.starts = {Pose{}, Pose{}};
  EXPECT_THAT(error_of(r), HasSubstr("2 start poses are given for 1 robots"));
  r.starts = {parse_pose("0,-30,0")};
  EXPECT_THAT(error_of(r), HasSubstr("0.000000,-30.000000,0.00 of robot 1 touches an obstacle"));
  r.robots = 2;
  r.starts = {parse_pose("2,-11,0"), parse_pose("2.1,-11,0")};
  EXPECT_THAT(error_of(r), HasSubstr("robots 1 and 2 overlap"));
}

TEST(ParsePose, ReadsMetresAndDegrees) {
  const Pose pose = parse_pose("1.5,-2,90");
  EXPECT_EQ(pose.position, (Point{1'500'000, -2'000'000}));
  EXPECT_EQ(pose.heading, BinaryAngle(std::uint16_t{0x4000}));
  EXPECT_EQ(parse_pose(format_pose(pose)), pose);
  for (const char* text : {"", "1", "1,2", "1,2,3,4", "a,b,c", "1,2,3x", "1e9,0,0", "nan,0,0"}) {
    EXPECT_THROW(parse_pose(text), std::invalid_argument) << text;
  }
}

}  // namespace
}  // namespace ivfm::host

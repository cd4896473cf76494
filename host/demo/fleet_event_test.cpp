#include "host/demo/fleet_event.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>

namespace ivfm::host {
namespace {

using Kind = FleetEvent::Kind;

TEST(FleetEvent, ReadsWhoAndWhen) {
  const FleetEvent join = parse_fleet_event(Kind::kJoin, "3@20s");
  EXPECT_EQ(join.kind, Kind::kJoin);
  EXPECT_EQ(join.robot, 3);
  EXPECT_EQ(join.at_us, 20'000'000u);
  EXPECT_FALSE(join.again_us.has_value());
  const FleetEvent crash = parse_fleet_event(Kind::kCrash, "2@1.5s+500ms");
  EXPECT_EQ(crash.at_us, 1'500'000u);
  EXPECT_EQ(crash.again_us, 2'000'000u);
}

TEST(FleetEvent, SaysWhatIsWrongAndWhatWouldBeRight) {
  for (const char* text : {"", "3", "3@", "@20s", "0@20s", "9@20s", "x@20s", "3@20", "3@20s+",
                           "3@20s+5", "3@20s+5s "}) {
    for (const Kind kind : {Kind::kCrash, Kind::kJoin}) {
      try {
        parse_fleet_event(kind, text);
        ADD_FAILURE() << text;
      } catch (const std::invalid_argument& error) {
        EXPECT_THAT(error.what(), testing::HasSubstr("ROBOT@TIME such as 2@30s"));
      }
    }
  }
  EXPECT_THROW(parse_fleet_event(Kind::kJoin, "3@20s+5s"), std::invalid_argument);
}

}  // namespace
}  // namespace ivfm::host

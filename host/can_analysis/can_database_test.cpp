#include "host/can_analysis/can_database.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ivfm::host {
namespace {

using testing::HasSubstr;

CanLogFrame frame_of(std::initializer_list<std::uint8_t> bytes) {
  CanLogFrame frame;
  for (const std::uint8_t byte : bytes) frame.data[frame.size++] = byte;
  return frame;
}

TEST(Dbc, TheShippedFileIsUnderstood) {
  const auto messages = parse_dbc(shipped_dbc());
  const DbcMessage& status = messages.at(0x181);
  EXPECT_EQ(status.name, "TPDO1_Left");
  EXPECT_EQ(status.sender, "DriveLeft");
  EXPECT_EQ(status.size, 6);
  const CanLogFrame frame = frame_of({0x37, 0x02, 0xff, 0xff, 0xff, 0xff});
  EXPECT_EQ(status.signal("Statusword")->raw(frame), 0x0237);
  EXPECT_EQ(status.signal("ActualVelocity")->raw(frame), -1);
  EXPECT_EQ(status.signal("ActualVelocity")->unit, "counts/s");
  EXPECT_EQ(status.signal("Nothing"), nullptr);
  EXPECT_EQ(messages.at(0x701).signal("NmtState")->values.at(5), "operational");
}

TEST(Dbc, ScalesAndCutsBits) {
  const auto messages = parse_dbc(
      "BO_ 5 X: 2 Y\n SG_ S : 4|4@1- (0.5,10) [0|0] \"m\" Z\n SG_ T : 0|16@1+ (1,0) [0|0] \"\" "
      "Z\n");
  const CanLogFrame frame = frame_of({0xf3, 0x01});
  EXPECT_DOUBLE_EQ(messages.at(5).signal("S")->value(frame), 9.5);  // -1 * 0.5 + 10
  EXPECT_EQ(messages.at(5).signal("T")->raw(frame), 0x1f3);
}

TEST(Dbc, SaysWhichLineItDoesNotUnderstand) {
  const auto failure = [](const char* text) {
    try {
      parse_dbc(text);
    } catch (const std::runtime_error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_THAT(failure("nothing"), HasSubstr("no message"));
  EXPECT_THAT(failure("\nBO_ x"), HasSubstr("line 2"));
  EXPECT_THAT(failure("BO_ 5 X: 2 Y\n SG_ S : 0|4@0+ (1,0) [0|0] \"\" Z"), HasSubstr("Motorola"));
  EXPECT_THAT(failure("BO_ 5 X: 2 Y\n SG_ S : 9|8@1+ (1,0) [0|0] \"\" Z"), HasSubstr("not fit"));
  EXPECT_THAT(failure(" SG_ S : 0|8@1+ (1,0) [0|0] \"\" Z"), HasSubstr("no signal"));
}

TEST(Eds, TheShippedFileNamesItsObjects) {
  const auto names = parse_eds(shipped_eds());
  EXPECT_EQ((names.at({0x1000, 0})), "Device type");
  EXPECT_EQ((names.at({0x1016, 1})), "Consumer heartbeat time 1");
  EXPECT_TRUE(parse_eds("no section").empty());
}

}  // namespace
}  // namespace ivfm::host

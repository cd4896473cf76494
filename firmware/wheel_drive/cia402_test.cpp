#include "firmware/wheel_drive/cia402.h"

#include <gtest/gtest.h>

namespace ivfm::cia402 {
namespace {

// CiA 402-2, table 30: statuswords as drives send them (0x0200 remote, 0x0010 voltage, ...).
TEST(Cia402, ReadsTheStateFromTheStatusword) {
  EXPECT_EQ(state_of(0x0000), State::kNotReadyToSwitchOn);
  EXPECT_EQ(state_of(0x0250), State::kSwitchOnDisabled);
  EXPECT_EQ(state_of(0x0231), State::kReadyToSwitchOn);
  EXPECT_EQ(state_of(0x0233), State::kSwitchedOn);
  EXPECT_EQ(state_of(0x0637), State::kOperationEnabled);
  EXPECT_EQ(state_of(0x1237), State::kOperationEnabled);
  EXPECT_EQ(state_of(0x0217), State::kQuickStopActive);
  EXPECT_EQ(state_of(0x021f), State::kFaultReactionActive);
  EXPECT_EQ(state_of(0x0218), State::kFault);
  EXPECT_EQ(state_of(0x0238), State::kFault) << "bit 5 says nothing in a fault";
  EXPECT_EQ(state_of(0x0270), State::kSwitchOnDisabled) << "nor in switch on disabled";
}

TEST(Cia402, EveryStatuswordNamesAtMostOneState) {
  for (unsigned word = 0; word < 0x80; ++word) {
    int matches = 0;
    for (const StatusPattern& pattern : kStatusPatterns) {
      matches += (word & pattern.mask) == pattern.value;
    }
    EXPECT_LE(matches, 1) << word;
  }
}

// CiA 402-2, table 27.
TEST(Cia402, ControlwordsHaveTheProfilesBits) {
  EXPECT_EQ(controlword_of(Command::kShutdown), 0x0006);
  EXPECT_EQ(controlword_of(Command::kSwitchOn), 0x0007);
  EXPECT_EQ(controlword_of(Command::kEnableOperation), 0x000f);
  EXPECT_EQ(controlword_of(Command::kDisableVoltage), 0x0000);
  EXPECT_EQ(controlword_of(Command::kQuickStop), 0x0002);
  EXPECT_EQ(controlword_of(Command::kFaultReset), 0x0080);
  for (const Command command : {Command::kShutdown, Command::kSwitchOn, Command::kEnableOperation,
                                Command::kDisableVoltage, Command::kQuickStop}) {
    EXPECT_EQ(command_of(controlword_of(command)), command);
  }
  EXPECT_EQ(command_of(0x000d), Command::kDisableVoltage) << "bit 1 decides alone";
}

// Figure 8, transition by transition.
TEST(Cia402, WalksEveryTransition) {
  using enum State;
  struct Step {
    int number;
    State from;
    std::uint16_t controlword;
    State to;
  };
  for (const Step& step :
       {Step{2, kSwitchOnDisabled, 0x06, kReadyToSwitchOn},
        Step{3, kReadyToSwitchOn, 0x07, kSwitchedOn}, Step{4, kSwitchedOn, 0x0f, kOperationEnabled},
        Step{5, kOperationEnabled, 0x07, kSwitchedOn}, Step{6, kSwitchedOn, 0x06, kReadyToSwitchOn},
        Step{7, kReadyToSwitchOn, 0x00, kSwitchOnDisabled},
        Step{7, kReadyToSwitchOn, 0x02, kSwitchOnDisabled},
        Step{8, kOperationEnabled, 0x06, kReadyToSwitchOn},
        Step{9, kOperationEnabled, 0x00, kSwitchOnDisabled},
        Step{10, kSwitchedOn, 0x00, kSwitchOnDisabled},
        Step{10, kSwitchedOn, 0x02, kSwitchOnDisabled},
        Step{11, kOperationEnabled, 0x02, kQuickStopActive},
        Step{12, kQuickStopActive, 0x00, kSwitchOnDisabled}}) {
    EXPECT_EQ(next_state(step.from, command_of(step.controlword)), step.to) << step.number;
  }
  EXPECT_EQ(next_state(kFault, Command::kFaultReset), kSwitchOnDisabled);
  EXPECT_EQ(next_state(kFault, Command::kEnableOperation), kFault);
  EXPECT_EQ(next_state(kSwitchOnDisabled, Command::kEnableOperation), kSwitchOnDisabled);
}

}  // namespace
}  // namespace ivfm::cia402

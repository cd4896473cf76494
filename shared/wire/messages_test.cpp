#include "shared/wire/messages.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace ivfm {
namespace {

using Bytes = std::vector<std::uint8_t>;

template <typename Message>
Bytes encoded(const Message& message) {
  Bytes out(100);
  const auto size = encode(message, out);
  EXPECT_TRUE(size.ok());
  out.resize(*size);
  return out;
}

// Cut bodies are truncated, longer ones corrupt.
template <typename Message, typename Decode>
void expect_exact_size(const Message& message, Decode decode) {
  Bytes body = encoded(message);
  for (std::size_t size = 0; size < body.size(); ++size) {
    EXPECT_EQ(decode(std::span<const std::uint8_t>(body).first(size)).status(), Status::kTruncated);
    Bytes small(size);
    EXPECT_EQ(encode(message, small).status(), Status::kFull);
  }
  body.push_back(0);
  EXPECT_EQ(decode(std::span<const std::uint8_t>(body)).status(), Status::kCorrupt);
}

TEST(Messages, AnAcknowledgementLeavesOutTheZerosAtItsEnd) {
  const Acknowledgement full{0x04030201, 0x0c0b0a0908070605};
  EXPECT_EQ(encoded(full), (Bytes{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12}));
  EXPECT_EQ(encoded(Acknowledgement{1, 0}), (Bytes{1, 0, 0, 0}));
  EXPECT_EQ(encoded(Acknowledgement{1, 0x100}), (Bytes{1, 0, 0, 0, 0, 1}));
  for (const Acknowledgement& ack : {full, Acknowledgement{1, 0}, Acknowledgement{1, 0x100}}) {
    EXPECT_EQ(*decode_acknowledgement(encoded(ack)), ack);
  }
  EXPECT_EQ(decode_acknowledgement(Bytes{1, 0, 0}).status(), Status::kTruncated);
  EXPECT_EQ(decode_acknowledgement(Bytes{1, 0, 0, 0, 0}).status(), Status::kCorrupt);
  EXPECT_EQ(decode_acknowledgement(Bytes(13, 1)).status(), Status::kCorrupt);
}

TEST(Messages, AnAcknowledgementCoversItsNewestAndTheBitsBelow) {
  const Acknowledgement ack{100, (1u << 0) | (std::uint64_t{1} << 63)};
  EXPECT_TRUE(ack.covers(100));
  EXPECT_TRUE(ack.covers(99));
  EXPECT_FALSE(ack.covers(98));
  EXPECT_TRUE(ack.covers(36));
  EXPECT_FALSE(ack.covers(35));
  EXPECT_FALSE(ack.covers(101));
  EXPECT_FALSE((Acknowledgement{1, 0}.covers(0xffffffffu)));
}

TEST(Messages, HelloCarriesCellSizeWindowAndName) {
  Hello hello{50000, {-2, 3, 1536, 160}, true, {}, 0};
  hello.set_name("r2\n");
  const Bytes body = encoded(hello);
  EXPECT_EQ(body, (Bytes{0x50, 0xc3, 0x00, 0xfe, 0xff, 0xff, 0x03, 0x00, 0x00, 0x00, 0x06, 0xa0,
                         0x00, 1, 3, 'r', '2', '?'}));
  const auto back = decode_hello(body);
  ASSERT_TRUE(back.ok());
  EXPECT_EQ(back->cell_um, 50000);
  EXPECT_EQ(back->window, hello.window);
  EXPECT_TRUE(back->resuming);
  EXPECT_EQ(back->name(), "r2?");
  expect_exact_size(hello, decode_hello);
}

TEST(Messages, HelloRefusesLongOrUnprintableNamesUnknownFlagsAndCellsOfNoSize) {
  Hello hello{50000, {0, 0, 1, 1}, false, {}, 0};
  hello.set_name("a name of far more than twenty-four characters");
  EXPECT_EQ(hello.name(), "a name of far more than ");
  const auto hello_with = [](std::uint8_t cell, std::uint8_t flags, Bytes name) {
    Bytes body(15);
    body[0] = cell;
    body[13] = flags;
    body[14] = static_cast<std::uint8_t>(name.size());
    body.insert(body.end(), name.begin(), name.end());
    return decode_hello(body).status();
  };
  EXPECT_EQ(hello_with(1, 0, {'x'}), Status::kOk);
  EXPECT_EQ(hello_with(1, 0, Bytes(25, 'x')), Status::kCorrupt);
  EXPECT_EQ(hello_with(1, 0, {0x07}), Status::kCorrupt);
  EXPECT_EQ(hello_with(1, 15, {'x'}), Status::kOk);
  EXPECT_EQ(hello_with(1, 16, {'x'}), Status::kCorrupt);
  EXPECT_EQ(hello_with(0, 0, {'x'}), Status::kCorrupt);
}

TEST(Messages, WelcomeAndRestoreSurviveTheRoundTrip) {
  const Welcome welcome{0x01020304, false, true};
  EXPECT_EQ(encoded(welcome), (Bytes{4, 3, 2, 1, 2}));
  EXPECT_EQ(*decode_welcome(encoded(welcome)), welcome);
  EXPECT_EQ(decode_welcome(Bytes{4, 3, 2, 1, 4}).status(), Status::kCorrupt);
  expect_exact_size(welcome, decode_welcome);
  const RestoreRequest request{{-1, -2, 3, 4}, {1, -5, 6}};
  EXPECT_EQ(*decode_restore_request(encoded(request)), request);
  expect_exact_size(request, decode_restore_request);
  const RestoreHeader header{{0, 1, -2}, {.layer = RestoreCursor::kEnd}};
  EXPECT_EQ(encoded(header).size(), kRestoreHeaderBytes);
  EXPECT_EQ(*decode_restore_header(encoded(header)), header);
  EXPECT_EQ(decode_restore_header(Bytes(13)).status(), Status::kTruncated);
}

TEST(Messages, StatusSurvivesTheRoundTrip) {
  RobotStatus status;
  status.pose = {1, 2, 3};
  status.state = 4;
  status.fault = 5;
  status.goal = {-100000, 100000};
  status.uptime_ms = 6;
  status.actions = 7;
  status.distance_mm = 8;
  status.decision_us = 9;
  status.datagrams_sent = 10;
  status.retransmissions = 11;
  const Bytes body = encoded(status);
  EXPECT_EQ(body.size(), kRobotStatusBytes);
  EXPECT_EQ(*decode_robot_status(body), status);
  expect_exact_size(status, decode_robot_status);
}

TEST(Messages, FoundSurvivesTheRoundTrip) {
  const FoundReport found{{1, 2, 3}, {-2000000000, 2000000000}};
  const Bytes body = encoded(found);
  EXPECT_EQ(body.size(), kFoundReportBytes);
  EXPECT_EQ(*decode_found_report(body), found);
  expect_exact_size(found, decode_found_report);
}

TEST(Messages, CommandsAreOnlyTheKnownOnes) {
  const Command command{CommandCode::kReturn, 0x01020304};
  EXPECT_EQ(encoded(command), (Bytes{3, 4, 3, 2, 1}));
  EXPECT_EQ(*decode_command(encoded(command)), command);
  EXPECT_EQ(decode_command(Bytes{0, 1, 0, 0, 0}).status(), Status::kCorrupt);
  EXPECT_EQ(decode_command(Bytes{5, 1, 0, 0, 0}).status(), Status::kCorrupt);
  expect_exact_size(command, decode_command);
}

TEST(Messages, PlacesAreAtMostEight) {
  RobotPlaces message;
  for (std::uint8_t i = 0; i < RobotPlaces::kMost; ++i) {
    EXPECT_EQ(encoded(message).size(), i * 5u);
    EXPECT_EQ(*decode_robot_places(encoded(message)), message);
    message.storage[message.size++] = {float16_from_um(1'500'000), float16_from_um(-i), i};
  }
  Bytes body = encoded(message);
  EXPECT_EQ((Bytes{body.begin(), body.begin() + 5}), (Bytes{0x00, 0x3e, 0, 0, 0}));
  EXPECT_EQ(*decode_robot_places(body), message);
  body.pop_back();
  EXPECT_EQ(decode_robot_places(body).status(), Status::kTruncated);
  body.resize(45);
  EXPECT_EQ(decode_robot_places(body).status(), Status::kCorrupt);
  EXPECT_EQ(decode_robot_places(Bytes{0, 0x7c, 0, 0, 0}).status(), Status::kCorrupt);  // infinite
}

TEST(Messages, AMapFrameIsForOneEpoch) {
  const MapFrame message{0x01020304, {{1'500'000, -2}, BinaryAngle(0x8001)}};
  const Bytes body = encoded(message);
  EXPECT_EQ(body, (Bytes{4, 3, 2, 1, 0x60, 0xe3, 0x16, 0, 0xfe, 0xff, 0xff, 0xff, 0x01, 0x80}));
  EXPECT_EQ(body.size(), kMapFrameBytes);
  EXPECT_EQ(*decode_map_frame(body), message);
  expect_exact_size(message, decode_map_frame);
}

TEST(Messages, RandomBytesNeverHarm) {
  std::mt19937 random(1);
  for (int round = 0; round < 50000; ++round) {
    Bytes body(random() % 48);
    for (auto& byte : body) byte = static_cast<std::uint8_t>(random() & 0xffu);
    static_cast<void>(decode_acknowledgement(body));
    static_cast<void>(decode_hello(body));
    static_cast<void>(decode_welcome(body));
    static_cast<void>(decode_restore_request(body));
    static_cast<void>(decode_restore_header(body));
    static_cast<void>(decode_robot_status(body));
    static_cast<void>(decode_found_report(body));
    static_cast<void>(decode_command(body));
    static_cast<void>(decode_robot_places(body));
    static_cast<void>(decode_map_frame(body));
  }
}

}  // namespace
}  // namespace ivfm

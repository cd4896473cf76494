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

TEST(Messages, AnAcknowledgementHasTheDocumentedBytes) {
  const Acknowledgement ack{0x04030201, 0x08070605, 0x100f0e0d0c0b0a09};
  EXPECT_EQ(encoded(ack), (Bytes{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16}));
  EXPECT_EQ(*decode_acknowledgement(encoded(ack)), ack);
  expect_exact_size(ack, decode_acknowledgement);
}

TEST(Messages, AnAcknowledgementCoversItsNewestAndTheBitsBelow) {
  const Acknowledgement ack{1, 100, (1u << 0) | (std::uint64_t{1} << 63)};
  EXPECT_TRUE(ack.covers(100));
  EXPECT_TRUE(ack.covers(99));
  EXPECT_FALSE(ack.covers(98));
  EXPECT_TRUE(ack.covers(36));
  EXPECT_FALSE(ack.covers(35));
  EXPECT_FALSE(ack.covers(101));
  EXPECT_FALSE((Acknowledgement{1, 1, 0}.covers(0xffffffffu)));
}

TEST(Messages, HelloCarriesCellSizeWindowAndName) {
  Hello hello{50000, 1536, 160, {}, 0};
  hello.set_name("r2\n");
  const Bytes body = encoded(hello);
  EXPECT_EQ(body, (Bytes{0x50, 0xc3, 0x00, 0x00, 0x06, 0xa0, 0x00, 3, 'r', '2', '?'}));
  const auto back = decode_hello(body);
  ASSERT_TRUE(back.ok());
  EXPECT_EQ(back->cell_um, 50000);
  EXPECT_EQ(back->window_width, 1536);
  EXPECT_EQ(back->window_height, 160);
  EXPECT_EQ(back->name(), "r2?");
  expect_exact_size(hello, decode_hello);
}

TEST(Messages, HelloRefusesLongOrUnprintableNamesAndCellsOfNoSize) {
  Hello hello{50000, 1, 1, {}, 0};
  hello.set_name("a name of far more than twenty-four characters");
  EXPECT_EQ(hello.name(), "a name of far more than ");
  Bytes body = {0x50, 0xc3, 0, 1, 0, 1, 0, 25};
  body.insert(body.end(), 25, 'x');
  EXPECT_EQ(decode_hello(body).status(), Status::kCorrupt);
  EXPECT_EQ(decode_hello(Bytes{1, 0, 0, 1, 0, 1, 0, 1, 0x07}).status(), Status::kCorrupt);
  EXPECT_EQ(decode_hello(Bytes{0, 0, 0, 1, 0, 1, 0, 0}).status(), Status::kCorrupt);
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

TEST(Messages, RandomBytesNeverHarm) {
  std::mt19937 random(1);
  for (int round = 0; round < 50000; ++round) {
    Bytes body(random() % 48);
    for (auto& byte : body) byte = static_cast<std::uint8_t>(random() & 0xffu);
    static_cast<void>(decode_acknowledgement(body));
    static_cast<void>(decode_hello(body));
    static_cast<void>(decode_robot_status(body));
    static_cast<void>(decode_found_report(body));
    static_cast<void>(decode_command(body));
  }
}

}  // namespace
}  // namespace ivfm

#include "firmware/hal/fake/faulty_channel.h"

#include <gtest/gtest.h>

#include <bit>
#include <numeric>

namespace ivfm {
namespace {

using Bytes = FaultyChannel::Bytes;

// Sends `count` datagrams, one a millisecond, and collects what arrives within a minute.
std::vector<Bytes> pass(FaultyChannel& channel, int count, std::size_t size = 100) {
  std::vector<Bytes> arrived;
  const auto collect = [&](TimeUs now_us) {
    while (const auto datagram = channel.receive(now_us)) arrived.push_back(*datagram);
  };
  for (int i = 0; i < count; ++i) {
    Bytes datagram(size, static_cast<std::uint8_t>(i >> 8));
    datagram[0] = static_cast<std::uint8_t>(i & 0xff);
    channel.send(datagram, static_cast<TimeUs>(i) * 1000);
    collect(static_cast<TimeUs>(i) * 1000);
  }
  collect(60'000'000);
  return arrived;
}

int number_of(const Bytes& datagram) { return datagram[0] + 256 * datagram[1]; }

int overtaken(const std::vector<Bytes>& arrived) {
  int count = 0;
  for (std::size_t i = 1; i < arrived.size(); ++i) {
    count += number_of(arrived[i]) < number_of(arrived[i - 1]) ? 1 : 0;
  }
  return count;
}

TEST(FaultyChannel, WithoutFaultsEverythingArrivesAtOnceAndInOrder) {
  FaultyChannel channel(1, {});
  for (std::uint8_t i = 0; i < 3; ++i) channel.send(Bytes{i}, 7);
  EXPECT_EQ(channel.next_arrival_us(), 7u);
  EXPECT_FALSE(channel.receive(6).has_value());
  for (std::uint8_t i = 0; i < 3; ++i) EXPECT_EQ(channel.receive(7), Bytes{i});
  EXPECT_FALSE(channel.next_arrival_us().has_value());
}

TEST(FaultyChannel, TheSameSeedGivesTheSameFaults) {
  const RadioFaults faults{.drop = 0.3,
                           .duplicate = 0.1,
                           .reorder = 0.1,
                           .corrupt = 0.1,
                           .truncate = 0.1,
                           .jitter_us = 5000};
  FaultyChannel a(5, faults), b(5, faults), c(6, faults);
  const auto from_a = pass(a, 500);
  EXPECT_EQ(from_a, pass(b, 500));
  EXPECT_NE(from_a, pass(c, 500));
}

TEST(FaultyChannel, DropsAndDuplicatesAsOftenAsTold) {
  FaultyChannel lossy(1, {.drop = 0.3}), doubling(2, {.duplicate = 0.1});
  EXPECT_NEAR(static_cast<double>(pass(lossy, 10000).size()), 7000, 200);
  EXPECT_NEAR(static_cast<double>(lossy.counters().lost), 3000, 200);
  EXPECT_NEAR(static_cast<double>(pass(doubling, 10000).size()), 11000, 150);
}

TEST(FaultyChannel, ReorderingAndJitterLoseNothing) {
  for (const RadioFaults& faults : {RadioFaults{.reorder = 0.1}, RadioFaults{.jitter_us = 9000}}) {
    FaultyChannel channel(3, faults);
    const auto arrived = pass(channel, 2000);
    EXPECT_EQ(arrived.size(), 2000u);
    EXPECT_GT(overtaken(arrived), 100);
  }
}

TEST(FaultyChannel, CorruptionFlipsOneBitAndTruncationTakesTheEnd) {
  FaultyChannel corrupting(4, {.corrupt = 1}), cutting(4, {.truncate = 1});
  for (const Bytes& datagram : pass(corrupting, 200)) {
    ASSERT_EQ(datagram.size(), 100u);
  }
  EXPECT_EQ(corrupting.counters().spoiled, 200u);
  corrupting.send(Bytes(10, 0), 0);
  const Bytes spoiled = *corrupting.receive(0);
  EXPECT_EQ(std::accumulate(spoiled.begin(), spoiled.end(), 0,
                            [](int bits, std::uint8_t b) { return bits + std::popcount(b); }),
            1);
  for (const Bytes& datagram : pass(cutting, 200)) ASSERT_LT(datagram.size(), 100u);
}

TEST(FaultyChannel, NothingSentDuringAPartitionArrives) {
  FaultyChannel channel(1, {.delay_us = 5000, .partitions = {{100'000, 200'000}}});
  const auto arrived = pass(channel, 300);
  ASSERT_EQ(arrived.size(), 200u);
  EXPECT_EQ(number_of(arrived[99]), 99);
  EXPECT_EQ(number_of(arrived[100]), 200);
}

// 1,000 bytes of 128 with headers in each 1/10 s: what would wait longer than a second is lost.
TEST(FaultyChannel, KeepsTheRate) {
  FaultyChannel channel(1, {.bytes_per_second = 10000});
  for (int i = 0; i < 1000; ++i) channel.send(Bytes(100), 0);
  int in_a_tenth = 0, later = 0;
  while (channel.receive(100'000)) ++in_a_tenth;
  while (channel.receive(60'000'000)) ++later;
  EXPECT_EQ(in_a_tenth, 7);
  EXPECT_NEAR(in_a_tenth + later, 80, 2);
  EXPECT_EQ(channel.counters().lost, 1000u - static_cast<unsigned>(in_a_tenth + later));
}

}  // namespace
}  // namespace ivfm

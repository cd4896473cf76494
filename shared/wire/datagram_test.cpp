#include "shared/wire/datagram.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>
#include <vector>

#include "shared/wire/byte_reader.h"
#include "shared/wire/byte_writer.h"

namespace ivfm {
namespace {

using Buffer = std::array<std::uint8_t, kMaxDatagramBytes>;
constexpr std::uint64_t kReceiver = 0x77;
constexpr SealContext kFromRobot{false, kReceiver};
constexpr DatagramHeader kHeader{0x1234, 0x89abcdef, 0x01020304, 0x1122334455667788,
                                 MessageKind::kStatus};

std::vector<std::uint8_t> sealed(const DatagramHeader& header, std::vector<std::uint8_t> body) {
  Buffer buffer{};
  std::copy(body.begin(), body.end(), body_of(buffer).begin());
  const auto size = seal_datagram(header, body.size(), buffer, kPlainSeal, kReceiver);
  EXPECT_TRUE(size.ok());
  return {buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(*size)};
}

Result<OpenedDatagram> open(std::vector<std::uint8_t>& datagram,
                            const SealContext& context = kFromRobot) {
  return open_datagram(datagram, kPlainSeal, context);
}

TEST(Datagram, HasTheHeaderThatTheDocumentSays) {
  const auto datagram = sealed(kHeader, {0xaa, 0xbb});
  ASSERT_EQ(datagram.size(), 27u);
  const std::vector<std::uint8_t> expected = {0x49, 0x20, 0x34, 0x12, 0xef, 0xcd, 0xab, 0x89,
                                              0x04, 0x03, 0x02, 0x01, 0x88, 0x77, 0x66, 0x55,
                                              0x44, 0x33, 0x22, 0x11, 0x04, 0xaa, 0xbb};
  EXPECT_TRUE(std::equal(expected.begin(), expected.end(), datagram.begin()));
}

TEST(Datagram, OpensWhatWasSealed) {
  auto datagram = sealed(kHeader, {1, 2, 3});
  EXPECT_EQ(*peek_robot(datagram), 0x1234);
  const auto opened = open(datagram);
  ASSERT_TRUE(opened.ok());
  EXPECT_EQ(opened->header, kHeader);
  EXPECT_TRUE(opened->bound);
  EXPECT_TRUE(std::ranges::equal(opened->body, std::vector<std::uint8_t>{1, 2, 3}));
}

TEST(Datagram, OpensForItsReceiversPresentStartAndDirectionOnly) {
  auto datagram = sealed(kHeader, {1, 2, 3});
  EXPECT_EQ(open(datagram, {false, kReceiver + 1}).status(), Status::kRefused);
  EXPECT_EQ(open(datagram, {true, kReceiver}).status(), Status::kRefused);
  EXPECT_TRUE(open(datagram).ok());
}

TEST(Datagram, OneForAnUnknownReceiverSaysSo) {
  Buffer buffer{};
  const std::size_t size = *seal_datagram(kHeader, 0, buffer, kPlainSeal, 0);
  EXPECT_EQ(buffer[1], 0x22);
  const auto opened = open_datagram(std::span(buffer).first(size), kPlainSeal, kFromRobot);
  ASSERT_TRUE(opened.ok());
  EXPECT_FALSE(opened->bound);
}

TEST(Datagram, NeverReaches1200Bytes) {
  EXPECT_EQ(sealed(kHeader, std::vector<std::uint8_t>(kMaxBodyBytes)).size(), 1185u);
  EXPECT_EQ(kMaxDatagramBytes, 1197u);
  Buffer buffer{};
  const auto seal = [&](DatagramHeader header, std::size_t size, std::span<std::uint8_t> out) {
    return seal_datagram(header, size, out, kPlainSeal, kReceiver).status();
  };
  EXPECT_EQ(seal(kHeader, kMaxBodyBytes + 1, buffer), Status::kInvalidArgument);
  EXPECT_EQ(seal(kHeader, 0, std::span(buffer).first(100)), Status::kInvalidArgument);
  EXPECT_EQ(seal({0, 1, 1, 1, MessageKind::kHello}, 0, buffer), Status::kInvalidArgument);
  EXPECT_EQ(seal({1, 1, 1, 0, MessageKind::kHello}, 0, buffer), Status::kInvalidArgument);
}

TEST(Datagram, EveryFlippedBitIsNoticed) {
  const auto good = sealed(kHeader, {1, 2, 3, 4, 5});
  for (std::size_t bit = 0; bit < good.size() * 8; ++bit) {
    auto bad = good;
    bad[bit / 8] = static_cast<std::uint8_t>(bad[bit / 8] ^ (1u << (bit % 8)));
    ASSERT_FALSE(open(bad).ok()) << bit;
  }
}

TEST(Datagram, CutOrTooLongDatagramsAreRefused) {
  const auto good = sealed(kHeader, {1, 2, 3, 4, 5});
  for (std::size_t size = 0; size < good.size(); ++size) {
    std::vector<std::uint8_t> cut(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size));
    ASSERT_EQ(open(cut).status(), size < 25 ? Status::kTruncated : Status::kRefused) << size;
  }
  std::vector<std::uint8_t> long_one(kMaxDatagramBytes + 1);
  EXPECT_EQ(open(long_one).status(), Status::kOutOfRange);
  auto longer_than_plain = sealed(kHeader, std::vector<std::uint8_t>(kMaxBodyBytes));
  longer_than_plain.push_back(0);
  EXPECT_EQ(open(longer_than_plain).status(), Status::kOutOfRange);
}

TEST(Datagram, UnknownVersionsProtectionsAndKindsAreUnsupported) {
  for (const unsigned version : {0x10u, 0x21u, 0x24u, 0x28u, 0x30u}) {
    auto datagram = sealed(kHeader, {});
    datagram[1] = static_cast<std::uint8_t>(version);
    EXPECT_EQ(open(datagram).status(), Status::kUnsupported) << version;
  }
  auto odd = sealed({1, 1, 1, 1, static_cast<MessageKind>(0x77)}, {});
  EXPECT_EQ(open(odd).status(), Status::kUnsupported);
}

TEST(Datagram, RandomBytesAreNotAccepted) {
  std::mt19937 random(1);
  for (int round = 0; round < 100000; ++round) {
    std::vector<std::uint8_t> bytes(random() % 64);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random() & 0xffu);
    if (bytes.size() > 1) {
      bytes[0] = kDatagramMagic;
      bytes[1] = 0x20;
    }
    ASSERT_FALSE(open(bytes).ok());
  }
}

TEST(ByteReader, NeverReadsPastTheEnd) {
  const std::array<std::uint8_t, 5> bytes = {0xff, 0xff, 0xff, 0x01, 0x02};
  ByteReader reader(bytes);
  EXPECT_EQ(reader.i24(), -1);
  EXPECT_EQ(reader.u32(), 0u);
  EXPECT_FALSE(reader.ok());
  EXPECT_EQ(reader.u8(), 0u);
  EXPECT_EQ(reader.remaining(), 0u);
}

TEST(ByteWriter, NeverWritesPastTheEnd) {
  std::array<std::uint8_t, 5> bytes{};
  ByteWriter writer(bytes);
  writer.i24(-2);
  writer.u32(7);
  EXPECT_FALSE(writer.ok());
  EXPECT_EQ(writer.size(), 3u);
  EXPECT_EQ(bytes, (std::array<std::uint8_t, 5>{0xfe, 0xff, 0xff, 0, 0}));
}

}  // namespace
}  // namespace ivfm

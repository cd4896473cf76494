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
constexpr DatagramHeader kHeader{0x1234, 0x89abcdef, 0x01020304, MessageKind::kStatus};

std::vector<std::uint8_t> sealed(const DatagramHeader& header, std::vector<std::uint8_t> body) {
  Buffer buffer{};
  std::copy(body.begin(), body.end(), body_of(buffer).begin());
  const auto size = seal_datagram(header, body.size(), buffer);
  EXPECT_TRUE(size.ok());
  return {buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(*size)};
}

TEST(Datagram, HasTheHeaderThatTheDocumentSays) {
  const auto datagram = sealed(kHeader, {0xaa, 0xbb});
  ASSERT_EQ(datagram.size(), 19u);
  const std::vector<std::uint8_t> expected = {0x49, 0x10, 0x34, 0x12, 0xef, 0xcd, 0xab, 0x89,
                                              0x04, 0x03, 0x02, 0x01, 0x04, 0xaa, 0xbb};
  EXPECT_TRUE(std::equal(expected.begin(), expected.end(), datagram.begin()));
}

TEST(Datagram, OpensWhatWasSealed) {
  const auto datagram = sealed(kHeader, {1, 2, 3});
  const auto opened = open_datagram(datagram);
  ASSERT_TRUE(opened.ok());
  EXPECT_EQ(opened->header, kHeader);
  EXPECT_TRUE(std::ranges::equal(opened->body, std::vector<std::uint8_t>{1, 2, 3}));
}

TEST(Datagram, NeverReaches1200Bytes) {
  EXPECT_EQ(sealed(kHeader, std::vector<std::uint8_t>(kMaxBodyBytes)).size(), 1177u);
  Buffer buffer{};
  EXPECT_EQ(seal_datagram(kHeader, kMaxBodyBytes + 1, buffer).status(), Status::kInvalidArgument);
  EXPECT_EQ(seal_datagram(kHeader, 0, std::span(buffer).first(100)).status(),
            Status::kInvalidArgument);
  EXPECT_EQ(seal_datagram({0, 1, 1, MessageKind::kHello}, 0, buffer).status(),
            Status::kInvalidArgument);
}

TEST(Datagram, EveryFlippedBitIsNoticed) {
  const auto good = sealed(kHeader, {1, 2, 3, 4, 5});
  for (std::size_t bit = 0; bit < good.size() * 8; ++bit) {
    auto bad = good;
    bad[bit / 8] = static_cast<std::uint8_t>(bad[bit / 8] ^ (1u << (bit % 8)));
    ASSERT_FALSE(open_datagram(bad).ok()) << bit;
  }
}

TEST(Datagram, CutOrTooLongDatagramsAreRefused) {
  const auto good = sealed(kHeader, {1, 2, 3, 4, 5});
  for (std::size_t size = 0; size < good.size(); ++size) {
    const auto status = open_datagram(std::span(good).first(size)).status();
    ASSERT_EQ(status, size < 17 ? Status::kTruncated : Status::kCorrupt) << size;
  }
  EXPECT_EQ(open_datagram(std::vector<std::uint8_t>(kMaxDatagramBytes + 1)).status(),
            Status::kOutOfRange);
}

TEST(Datagram, UnknownVersionsProtectionsAndKindsAreUnsupported) {
  auto datagram = sealed(kHeader, {});
  datagram[1] = 0x20;
  EXPECT_EQ(open_datagram(datagram).status(), Status::kUnsupported);
  datagram[1] = 0x11;
  EXPECT_EQ(open_datagram(datagram).status(), Status::kUnsupported);
  const auto odd = sealed({1, 1, 1, static_cast<MessageKind>(0x77)}, {});
  EXPECT_EQ(open_datagram(odd).status(), Status::kUnsupported);
}

TEST(Datagram, RandomBytesAreNotAccepted) {
  std::mt19937 random(1);
  for (int round = 0; round < 100000; ++round) {
    std::vector<std::uint8_t> bytes(random() % 64);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random() & 0xffu);
    if (bytes.size() > 1) {
      bytes[0] = kDatagramMagic;
      bytes[1] = 0x10;
    }
    ASSERT_FALSE(open_datagram(bytes).ok());
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

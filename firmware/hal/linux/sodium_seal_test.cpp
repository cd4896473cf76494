#include "firmware/hal/linux/sodium_seal.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <numeric>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "firmware/hal/linux/random_boot.h"
#include "shared/wire/datagram.h"
#include "shared/wire/map_update.h"

namespace ivfm {
namespace {

using Bytes = std::vector<std::uint8_t>;
constexpr std::uint64_t kServer = 0x1817161514131211;
constexpr SealContext kFromRobot{false, kServer};
constexpr DatagramHeader kHeader{7, 0x5f3c2a10, 258, 0x0807060504030201, MessageKind::kMapUpdate};

RadioKey counting_key() {
  RadioKey key;
  std::iota(key.begin(), key.end(), std::uint8_t{0});
  return key;
}

const SodiumSeal kSeal(counting_key());

Bytes sealed(const Bytes& body, const DatagramHeader& header = kHeader,
             const DatagramSeal& seal = kSeal, std::uint64_t receiver = kServer) {
  Bytes buffer(kMaxDatagramBytes);
  std::copy(body.begin(), body.end(), body_of(buffer).begin());
  buffer.resize(*seal_datagram(header, body.size(), buffer, seal, receiver));
  return buffer;
}

Status opened(Bytes datagram, const DatagramSeal& seal = kSeal,
              const SealContext& context = kFromRobot) {
  return open_datagram(datagram, seal, context).status();
}

TEST(SodiumSeal, OpensWhatItSealed) {
  Bytes datagram = sealed({1, 2, 3});
  EXPECT_EQ(datagram.size(), 21u + 3 + 16);
  const auto result = open_datagram(datagram, kSeal, kFromRobot);
  ASSERT_TRUE(result.ok());
  EXPECT_EQ(result->header, kHeader);
  EXPECT_TRUE(std::ranges::equal(result->body, Bytes{1, 2, 3}));
}

TEST(SodiumSeal, HidesKindAndBody) {
  const Bytes plain = sealed({1, 2, 3}, kHeader, kPlainSeal);
  const Bytes secret = sealed({1, 2, 3});
  EXPECT_TRUE(std::equal(plain.begin() + 2, plain.begin() + 20, secret.begin() + 2));
  EXPECT_FALSE(std::equal(plain.begin() + 20, plain.begin() + 24, secret.begin() + 20));
}

TEST(SodiumSeal, EveryFlippedBitIsNoticed) {
  const Bytes good = sealed({1, 2, 3, 4, 5});
  for (std::size_t bit = 0; bit < good.size() * 8; ++bit) {
    Bytes bad = good;
    bad[bit / 8] = static_cast<std::uint8_t>(bad[bit / 8] ^ (1u << (bit % 8)));
    ASSERT_NE(opened(bad), Status::kOk) << bit;
  }
}

TEST(SodiumSeal, CutDatagramsAreNoticed) {
  const Bytes good = sealed({1, 2, 3, 4, 5});
  for (std::size_t size = 0; size < good.size(); ++size) {
    ASSERT_NE(opened(Bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size))),
              Status::kOk);
  }
}

TEST(SodiumSeal, AnotherKeyDirectionOrReceiversStartDoesNotOpen) {
  RadioKey other = counting_key();
  other[31] ^= 1;
  EXPECT_EQ(opened(sealed({1}), SodiumSeal(other)), Status::kRefused);
  EXPECT_EQ(opened(sealed({1}), kSeal, {true, kServer}), Status::kRefused);
  EXPECT_EQ(opened(sealed({1}), kSeal, {false, kServer + 1}), Status::kRefused);
  EXPECT_EQ(opened(sealed({1}), kPlainSeal), Status::kUnsupported);
  EXPECT_EQ(opened(sealed(Bytes(20), kHeader, kPlainSeal)), Status::kUnsupported);
}

// The nonce is what the head and the direction say: equal content never looks equal.
TEST(SodiumSeal, EveryNumberStartAndDirectionGivesAnotherCiphertext) {
  std::set<Bytes> seen;
  for (std::uint32_t sequence = 1; sequence <= 4; ++sequence) {
    for (std::uint32_t epoch = 1; epoch <= 2; ++epoch) {
      for (std::uint64_t boot = 1; boot <= 2; ++boot) {
        for (const auto kind : {MessageKind::kStatus, MessageKind::kCommand}) {
          const Bytes datagram = sealed(Bytes(40), {7, epoch, sequence, boot, kind});
          EXPECT_TRUE(seen.insert(Bytes(datagram.begin() + 21, datagram.begin() + 61)).second);
        }
      }
    }
  }
}

TEST(SodiumSeal, TheDocumentsExampleOpens) {
  std::ifstream file(IVFM_SOURCE_DIR "/shared/wire/FORMAT.md");
  Bytes datagram;
  bool inside = false;
  for (std::string line; std::getline(file, line);) {
    if (line == "```hex sealed-map-update") {
      inside = true;
    } else if (inside && line == "```") {
      break;
    } else if (inside) {
      std::istringstream words(line.substr(0, line.find('|')));
      for (std::string word; words >> word;) {
        datagram.push_back(static_cast<std::uint8_t>(std::stoul(word, nullptr, 16)));
      }
    }
  }
  const auto result = open_datagram(datagram, kSeal, kFromRobot);
  ASSERT_TRUE(result.ok()) << to_string(result.status());
  EXPECT_EQ(result->header, kHeader);
  MapUpdateReader reader(result->body);
  std::array<std::uint8_t, kMaxBlockCells> cells;
  EXPECT_EQ(reader.next(cells)->rect, (CellRect{-3, 5, 4, 3}));
  EXPECT_EQ(sealed(Bytes(result->body.begin(), result->body.end())).size(), 71u);
}

TEST(RandomNumbers, AreNotTheSameTwice) {
  EXPECT_NE(draw_boot(), draw_boot());
  EXPECT_NE(draw_radio_key(), draw_radio_key());
}

}  // namespace
}  // namespace ivfm

#include "shared/wire/crc.h"

#include <gtest/gtest.h>

#include <array>
#include <string_view>
#include <vector>

namespace ivfm {
namespace {

std::vector<std::uint8_t> bytes_of(std::string_view text) { return {text.begin(), text.end()}; }

// Check values from the catalogue of parametrised CRC algorithms ("CRC-32/ISO-HDLC") and RFC 1952.
TEST(Crc32, MatchesTheCatalogueCheckValue) { EXPECT_EQ(crc32(bytes_of("123456789")), 0xcbf43926u); }

TEST(Crc32, OfNothingIsZero) { EXPECT_EQ(crc32({}), 0u); }

TEST(Crc32, ContinuesOverPieces) {
  const auto all = bytes_of("123456789");
  const std::span<const std::uint8_t> view(all);
  for (std::size_t cut = 0; cut <= all.size(); ++cut) {
    EXPECT_EQ(crc32(view.subspan(cut), crc32(view.first(cut))), 0xcbf43926u);
  }
}

TEST(Crc32, NoticesEverySingleFlippedBit) {
  const auto good = bytes_of("a map update of some length");
  for (std::size_t bit = 0; bit < good.size() * 8; ++bit) {
    auto bad = good;
    bad[bit / 8] = static_cast<std::uint8_t>(bad[bit / 8] ^ (1u << (bit % 8)));
    EXPECT_NE(crc32(bad), crc32(good));
  }
}

}  // namespace
}  // namespace ivfm

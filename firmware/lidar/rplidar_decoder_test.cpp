#include "firmware/lidar/rplidar_decoder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <random>
#include <vector>

namespace ivfm {
namespace {

using Bytes = std::vector<std::uint8_t>;
using Event = RplidarDecoder::Event;

// Descriptors as the protocol document prints them.
const Bytes kInfoDescriptor = {0xa5, 0x5a, 0x14, 0x00, 0x00, 0x00, 0x04};
const Bytes kHealthDescriptor = {0xa5, 0x5a, 0x03, 0x00, 0x00, 0x00, 0x06};
const Bytes kSampleRateDescriptor = {0xa5, 0x5a, 0x04, 0x00, 0x00, 0x00, 0x15};
const Bytes kScanDescriptor = {0xa5, 0x5a, 0x05, 0x00, 0x00, 0x40, 0x81};
const Bytes kExpressDescriptor = {0xa5, 0x5a, 0x54, 0x00, 0x00, 0x40, 0x82};

Bytes operator+(Bytes a, const Bytes& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

struct Decoded {
  std::vector<Event> events;
  std::vector<RplidarSample> samples;
};

Decoded decode(RplidarDecoder& decoder, const Bytes& bytes) {
  Decoded decoded;
  for (const std::uint8_t byte : bytes) {
    const Event event = decoder.process(byte);
    if (event != Event::kNone) decoded.events.push_back(event);
    for (const RplidarSample& s : decoder.samples()) decoded.samples.push_back(s);
  }
  return decoded;
}

// A node of `angle_deg` and 1,000 mm, quality 15.
Bytes node(double angle_deg, bool start = false) {
  const auto angle = static_cast<unsigned>(angle_deg * 64) << 1 | 1u;
  return {static_cast<std::uint8_t>(15 << 2 | (start ? 1 : 2)), static_cast<std::uint8_t>(angle),
          static_cast<std::uint8_t>(angle >> 8), 0xa0, 0x0f};
}

// A capsule that starts at `start_deg`; all samples 500 mm without compensation.
Bytes capsule(double start_deg, bool anew = false) {
  const auto start = static_cast<unsigned>(start_deg * 64) | (anew ? 0x8000u : 0u);
  Bytes bytes = {0, 0, static_cast<std::uint8_t>(start), static_cast<std::uint8_t>(start >> 8)};
  for (int i = 0; i < 16; ++i) bytes = bytes + Bytes{0xd0, 0x07, 0xd0, 0x07, 0x00};
  std::uint8_t checksum = 0;
  for (std::size_t i = 2; i < bytes.size(); ++i) checksum ^= bytes[i];
  bytes[0] = static_cast<std::uint8_t>(0xa0 | (checksum & 0xf));
  bytes[1] = static_cast<std::uint8_t>(0x50 | (checksum >> 4));
  return bytes;
}

TEST(RplidarRequest, IsTheBytesOfTheProtocolDocument) {
  std::array<std::uint8_t, 16> out{};
  ASSERT_EQ(*rplidar::encode_request(rplidar::Request::kGetHealth, {}, out), 2u);
  EXPECT_EQ(out[0], 0xa5);
  EXPECT_EQ(out[1], 0x52);
  const Bytes legacy_mode(5, 0);
  ASSERT_EQ(*rplidar::encode_request(rplidar::Request::kExpressScan, legacy_mode, out), 9u);
  EXPECT_THAT(std::span(out).first(9), testing::ElementsAre(0xa5, 0x82, 5, 0, 0, 0, 0, 0, 0x22));
}

TEST(RplidarRequest, RefusesAPayloadWhereNoneBelongs) {
  std::array<std::uint8_t, 4> out{};
  const Bytes payload(5, 0);
  EXPECT_EQ(rplidar::encode_request(rplidar::Request::kStop, payload, out).status(),
            Status::kInvalidArgument);
  EXPECT_EQ(rplidar::encode_request(rplidar::Request::kExpressScan, {}, out).status(),
            Status::kInvalidArgument);
  EXPECT_EQ(rplidar::encode_request(rplidar::Request::kExpressScan, payload, out).status(),
            Status::kFull);
}

TEST(RplidarDecoder, ReadsDeviceInfo) {
  RplidarDecoder decoder;
  Bytes bytes = kInfoDescriptor + Bytes{24, 29, 1, 7};
  for (std::uint8_t i = 0; i < 16; ++i) bytes.push_back(static_cast<std::uint8_t>(0xd0 + i));
  EXPECT_THAT(decode(decoder, bytes).events, testing::ElementsAre(Event::kInfo));
  EXPECT_EQ(decoder.info().model, 24);
  EXPECT_EQ(decoder.info().firmware_major, 1);
  EXPECT_EQ(decoder.info().firmware_minor, 29);
  EXPECT_EQ(decoder.info().hardware, 7);
  EXPECT_EQ(decoder.info().serial_number[15], 0xdf);
  EXPECT_TRUE(decoder.info().has_express());
}

TEST(RplidarDecoder, ReadsHealthAndRefusesAnUnknownLevel) {
  RplidarDecoder decoder;
  EXPECT_THAT(decode(decoder, kHealthDescriptor + Bytes{2, 0x34, 0x12}).events,
              testing::ElementsAre(Event::kHealth));
  EXPECT_EQ(decoder.health(), (RplidarHealth{RplidarHealth::kError, 0x1234}));
  EXPECT_TRUE(decode(decoder, kHealthDescriptor + Bytes{3, 0, 0}).events.empty());
  EXPECT_EQ(decoder.health().error_code, 0x1234);
  EXPECT_EQ(decoder.counters().dropped_frames, 1u);
}

TEST(RplidarDecoder, ReadsSampleRateAndConfiguration) {
  RplidarDecoder decoder;
  EXPECT_THAT(decode(decoder, kSampleRateDescriptor + Bytes{0xfc, 0x01, 0xfe, 0x00}).events,
              testing::ElementsAre(Event::kSampleRate));
  EXPECT_EQ(decoder.sample_rate(), (RplidarSampleRate{508, 254}));
  const Bytes mode_count = {0xa5, 0x5a, 0x06, 0, 0, 0, 0x20, 0x70, 0, 0, 0, 0x02, 0x00};
  EXPECT_THAT(decode(decoder, mode_count).events, testing::ElementsAre(Event::kConfiguration));
  EXPECT_EQ(decoder.configuration_type(), 0x70u);
  EXPECT_THAT(decoder.configuration_value(), testing::ElementsAre(2, 0));
}

TEST(RplidarDecoder, ReadsStandardNodes) {
  RplidarDecoder decoder;
  // Quality 47, start bit, 90.5 degrees, 1234.5 mm; then quality 0, 92 degrees, nothing measured.
  const Bytes nodes = {0xbd, 0x41, 0x2d, 0x4a, 0x13, 0x02, 0x01, 0x2e, 0x00, 0x00};
  const Decoded decoded = decode(decoder, kScanDescriptor + nodes);
  EXPECT_THAT(decoded.events,
              testing::ElementsAre(Event::kScanStarted, Event::kSamples, Event::kSamples));
  ASSERT_EQ(decoded.samples.size(), 2u);
  EXPECT_EQ(decoded.samples[0], (RplidarSample{5792, 4938, 47, true}));
  EXPECT_EQ(decoded.samples[1], (RplidarSample{5888, 0, 0, false}));
  EXPECT_EQ(decoder.counters().skipped_bytes, 0u);
}

TEST(RplidarDecoder, CompensatesTheAnglesOfAnExpressCapsule) {
  RplidarDecoder decoder;
  // Starts at 10 degrees. First sample: 1000 mm, 7.5 degrees of compensation (60 in Q3: high bits
  // 3, low bits c); second: 2000 mm, 1.125 degrees (9). The other 30 samples are empty.
  Bytes first = {0xad, 0x56, 0x80, 0x82, 0xa3, 0x0f, 0x40, 0x1f, 0x9c};
  first.resize(84, 0);
  // The next one starts at 26 degrees: half a degree a sample.
  Bytes second = {0xa6, 0x58, 0x80, 0x06};
  second.resize(84, 0);
  const Decoded decoded = decode(decoder, kExpressDescriptor + first + second);
  EXPECT_THAT(decoded.events, testing::ElementsAre(Event::kScanStarted, Event::kSamples));
  ASSERT_EQ(decoded.samples.size(), 32u);
  EXPECT_EQ(decoded.samples[0], (RplidarSample{160, 4000, 47, false}));  // 10 - 7.5 = 2.5
  EXPECT_EQ(decoded.samples[1], (RplidarSample{600, 8000, 47, false}));  // 10.5 - 1.125 = 9.375
  EXPECT_EQ(decoded.samples[31], (RplidarSample{1632, 0, 0, false}));    // 25.5
}

TEST(RplidarDecoder, StartsARevolutionWhereTheRawAngleOfACapsulePassesZero) {
  RplidarDecoder decoder;
  const Decoded decoded =
      decode(decoder, kExpressDescriptor + capsule(352, true) + capsule(8) + capsule(24));
  ASSERT_EQ(decoded.samples.size(), 64u);
  for (std::size_t i = 0; i < 64; ++i) {
    EXPECT_EQ(decoded.samples[i].starts_revolution, i == 16) << i;
  }
  EXPECT_EQ(decoded.samples[16].angle_q6, 0);
}

TEST(RplidarDecoder, StartsARevolutionOnceWhenACapsuleBeginsJustAfterZero) {
  RplidarDecoder decoder;
  const Decoded decoded =
      decode(decoder, kExpressDescriptor + capsule(344.25, true) + capsule(0.25) + capsule(16.25));
  ASSERT_EQ(decoded.samples.size(), 64u);
  for (std::size_t i = 0; i < 64; ++i) {
    EXPECT_EQ(decoded.samples[i].starts_revolution, i == 32) << i;
  }
}

TEST(RplidarDecoder, DropsACorruptCapsuleAndTheOneWhoseEndItWas) {
  RplidarDecoder decoder;
  Bytes corrupt = capsule(32);
  corrupt[40] ^= 0x10;
  const Decoded decoded = decode(decoder, kExpressDescriptor + capsule(0, true) + capsule(16) +
                                              corrupt + capsule(48) + capsule(64));
  // 0..16 decoded; 16 and 32 lost; 48..64 decoded.
  ASSERT_EQ(decoded.samples.size(), 64u);
  EXPECT_EQ(decoded.samples[32].angle_q6, 48 * 64);
  EXPECT_EQ(decoder.counters().dropped_frames, 1u);
  EXPECT_EQ(decoder.counters().resyncs, 1u);
}

TEST(RplidarDecoder, FindsTheStreamAgainAfterLostBytes) {
  RplidarDecoder decoder;
  Bytes stream = kScanDescriptor;
  for (int i = 0; i < 40; ++i) stream = stream + node(i);
  stream.erase(stream.begin() + 7 + 10 * 5 + 2, stream.begin() + 7 + 11 * 5 + 4);
  const Decoded decoded = decode(decoder, stream);
  EXPECT_GE(decoded.samples.size(), 36u);
  EXPECT_EQ(decoder.counters().resyncs, 1u);
  EXPECT_EQ(decoded.samples.back().angle_q6, 39 * 64);
}

TEST(RplidarDecoder, FindsTheStreamAgainAfterGarbage) {
  std::mt19937 random(1);
  RplidarDecoder decoder;
  decode(decoder, kScanDescriptor + node(1) + node(2));
  Bytes garbage(501);
  for (auto& byte : garbage) byte = static_cast<std::uint8_t>(random());
  decode(decoder, garbage);
  Bytes stream;
  for (int i = 0; i < 60; ++i) stream = stream + node(100 + i);
  const Decoded decoded = decode(decoder, stream);
  EXPECT_GE(decoded.samples.size(), 50u);
  EXPECT_EQ(decoded.samples.back().angle_q6, 159 * 64);
  EXPECT_GT(decoder.counters().skipped_bytes, 100u);
}

TEST(RplidarDecoder, AcceptsAJumpOfTheAngleWhenTheNodesAfterItAgree) {
  RplidarDecoder decoder;
  Bytes stream = kScanDescriptor + node(1) + node(2);
  for (int i = 0; i < 10; ++i) stream = stream + node(200 + i);
  EXPECT_EQ(decode(decoder, stream).samples.size(), 12u);
}

TEST(RplidarDecoder, FindsADescriptorBehindTheBootText) {
  RplidarDecoder decoder;
  const std::string text = "RP LIDAR System.\r\nFirmware Ver 1.29 - rtm, HW Ver 7\r\nModel: 18\r\n";
  const Bytes boot(text.begin(), text.end());
  EXPECT_THAT(decode(decoder, boot + Bytes{0xa5, 0xa5} + kHealthDescriptor + Bytes{0, 0, 0}).events,
              testing::ElementsAre(Event::kHealth));
  EXPECT_EQ(decoder.counters().skipped_bytes, boot.size() + 2);
}

TEST(RplidarDecoder, NeverTrustsAnAnnouncedLength) {
  RplidarDecoder decoder;
  // Info of 2^30 - 1 bytes; health of 4; nodes of 84; configuration of 65; single-response nodes.
  const std::vector<Bytes> lies = {
      {0xa5, 0x5a, 0xff, 0xff, 0xff, 0x3f, 0x04}, {0xa5, 0x5a, 0x04, 0x00, 0x00, 0x00, 0x06},
      {0xa5, 0x5a, 0x54, 0x00, 0x00, 0x40, 0x81}, {0xa5, 0x5a, 0x41, 0x00, 0x00, 0x00, 0x20},
      {0xa5, 0x5a, 0x05, 0x00, 0x00, 0x00, 0x81}, {0xa5, 0x5a, 0x03, 0x00, 0x00, 0x80, 0x06}};
  for (const Bytes& lie : lies) EXPECT_TRUE(decode(decoder, lie).events.empty());
  EXPECT_EQ(decoder.counters().dropped_frames, lies.size());
  EXPECT_THAT(decode(decoder, kHealthDescriptor + Bytes{1, 0, 0}).events,
              testing::ElementsAre(Event::kHealth));
}

TEST(RplidarDecoder, WaitsForTheRestOfATruncatedAnswerAndForgetsItOnReset) {
  RplidarDecoder decoder;
  EXPECT_TRUE(decode(decoder, kInfoDescriptor + Bytes{24, 29}).events.empty());
  decoder.reset();
  EXPECT_THAT(decode(decoder, kHealthDescriptor + Bytes{0, 0, 0}).events,
              testing::ElementsAre(Event::kHealth));
}

TEST(RplidarDecoder, SurvivesRandomBytesInEveryState) {
  std::mt19937 random(7);
  for (const Bytes& opening : {Bytes{}, kInfoDescriptor, kScanDescriptor, kExpressDescriptor}) {
    RplidarDecoder decoder;
    decode(decoder, opening);
    for (int i = 0; i < 200'000; ++i) {
      // Half of the bytes come from the protocol's own markers, to get deep into each state.
      static constexpr std::uint8_t kMarkers[] = {0xa5, 0x5a, 0x81, 0x82, 0x00, 0x01, 0x3e, 0x40};
      const auto draw = random();
      const auto byte = static_cast<std::uint8_t>(draw & 0x100 ? draw : kMarkers[draw & 7]);
      decoder.process(byte);
      for (const RplidarSample& sample : decoder.samples()) {
        ASSERT_LT(sample.angle_q6, rplidar::kFullTurnQ6);
        ASSERT_LE(sample.quality, 63);
      }
      ASSERT_LE(decoder.configuration_value().size(), rplidar::kMaxConfigurationSize);
    }
  }
}

TEST(RplidarDecoder, SurvivesEveryFlippedBitOfAStream) {
  const Bytes stream = kExpressDescriptor + capsule(0, true) + capsule(16) + capsule(32);
  for (std::size_t bit = 0; bit < stream.size() * 8; ++bit) {
    Bytes flipped = stream;
    flipped[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
    RplidarDecoder decoder;
    for (const RplidarSample& sample : decode(decoder, flipped).samples) {
      EXPECT_LT(sample.angle_q6, rplidar::kFullTurnQ6);
    }
  }
}

}  // namespace
}  // namespace ivfm

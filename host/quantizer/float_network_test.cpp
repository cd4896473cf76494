#include "host/quantizer/float_network.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <stdexcept>

#include "firmware/nn/state_encoder.h"

namespace ivfm::host {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

TEST(Unet18, StaysWithinTheLimitsOfTheSmallestTarget) {
  const FloatNetwork network = make_unet18();
  EXPECT_LE(multiply_adds(network), kMaxMultiplyAdds);
  EXPECT_LE(weight_count(network), kMaxWeightBytes);
  EXPECT_NEAR(static_cast<double>(multiply_adds(network)), 20.6e6, 0.5e6);
  EXPECT_EQ(network.shapes().back(), (Shape{32, 32, 1}));
}

// A 3x3 convolution that sums its neighbourhood, then the head: sums drawn by hand.
FloatNetwork neighbourhood_sum(int stride) {
  NetworkBuilder b(StateKind::kFoldedIvfm, "sum");
  int x = b.conv3x3(NetworkBuilder::kInput, 1, stride);
  if (stride == 2) x = b.upsample2x(x);
  FloatNetwork network = b.finish(x);
  network.inputs = {{0.0f, 1.0f}};
  network.layers.front().weights.assign(9, 1.0f);
  network.layers.back().weights = {2.0f};
  network.layers.back().bias = {0.5f};
  return network;
}

TEST(FloatRunner, SumsNeighboursWithZeroPadding) {
  FloatRunner runner(neighbourhood_sum(1));
  const std::vector<std::uint16_t> ones(kPolicyGridSize, 1);
  const auto q = runner.run(ones);
  EXPECT_EQ(q[0], 2 * 4 + 0.5f);
  EXPECT_EQ(q[1], 2 * 6 + 0.5f);
  EXPECT_EQ(q[33], 2 * 9 + 0.5f);
  EXPECT_EQ(q[1023], 2 * 4 + 0.5f);
}

TEST(FloatRunner, AppliesTheKernelInRowColumnOrder) {
  FloatNetwork network = neighbourhood_sum(1);
  network.layers.front().weights = {0, 0, 0, 0, 0, 1, 0, 0, 0};  // the neighbour at x + 1
  FloatRunner runner(network);
  std::vector<std::uint16_t> state(kPolicyGridSize, 0);
  state[5 * 32 + 7] = 1;
  const auto q = runner.run(state);
  EXPECT_EQ(q[5 * 32 + 6], 2.5f);
  EXPECT_EQ(q[5 * 32 + 7], 0.5f);
}

TEST(FloatRunner, TakesEverySecondPixelWithStride2) {
  FloatRunner runner(neighbourhood_sum(2));
  std::vector<std::uint16_t> state(kPolicyGridSize, 0);
  state[2 * 32 + 3] =
      1;  // seen from (2, 2) and (2, 4), i.e. from (1, 1) and (1, 2) of the half grid
  const auto q = runner.run(state);
  EXPECT_EQ(q[2 * 32 + 2], 2.5f);
  EXPECT_EQ(q[3 * 32 + 5], 2.5f);
  EXPECT_EQ(q[2 * 32 + 6], 0.5f);
  EXPECT_EQ(q[0], 0.5f);
}

TEST(FloatRunner, ClampsItsInputs) {
  NetworkBuilder b(StateKind::kIvfm, "inputs");
  FloatNetwork network = b.finish(b.conv1x1(NetworkBuilder::kInput, 1));
  network.layers[0].weights = {1.0f, 10.0f};
  network.layers[1].weights = {1.0f};
  FloatRunner runner(network);
  std::vector<std::uint16_t> state(2 * kPolicyGridSize, 65535);
  state[0] = 20480;  // never seen
  state[1024] = 0;   // the robot's own cell
  state[1] = 49152;  // blocked, path 65535: out of reach
  state[2] = 0;
  state[1024 + 2] = 8320;  // half way to 65 policy cells
  const auto q = runner.run(state);
  EXPECT_FLOAT_EQ(q[0], 10.0f);
  EXPECT_FLOAT_EQ(q[1], 1.0f);
  EXPECT_FLOAT_EQ(q[2], 5.0f);
}

TEST(FloatRunner, RefusesAStateOfTheWrongSize) {
  FloatRunner runner(make_random_network(1));
  EXPECT_THROW(runner.run(std::vector<std::uint16_t>(1024)), std::invalid_argument);
}

TEST(FloatNetwork, NamesTheLayerThatDoesNotFit) {
  FloatNetwork network = make_unet18();
  network.layers[3].weights.pop_back();
  EXPECT_THAT([&] { network.shapes(); },
              ThrowsMessage<std::invalid_argument>(HasSubstr("layer 3: 9215 weights where 9216")));
  network = make_unet18();
  network.layers[2].input_a = 3;
  EXPECT_THAT([&] { network.shapes(); },
              ThrowsMessage<std::invalid_argument>(HasSubstr("layer 2: its operand, tensor 3")));
  network = make_unet18();
  network.layers.pop_back();
  EXPECT_THAT([&] { network.shapes(); },
              ThrowsMessage<std::invalid_argument>(HasSubstr("not a head")));
}

TEST(FloatNetworkFile, ReadsWhatItWrites) {
  FloatNetwork network = make_random_network(3);
  network.name = "a name";
  network.value_kind = ValueKind::kScore;
  network.policy_cell_um = 31'250;
  const std::vector<std::uint8_t> bytes = encode_network(network);
  const FloatNetwork read = decode_network(bytes);
  EXPECT_EQ(read.name, "a name");
  EXPECT_EQ(read.value_kind, ValueKind::kScore);
  EXPECT_EQ(read.policy_cell_um, 31'250u);
  ASSERT_EQ(read.layers.size(), network.layers.size());
  for (std::size_t i = 0; i < read.layers.size(); ++i) {
    EXPECT_EQ(read.layers[i].weights, network.layers[i].weights);
    EXPECT_EQ(read.layers[i].bias, network.layers[i].bias);
  }
  EXPECT_EQ(encode_network(read), bytes);
}

TEST(FloatNetworkFile, RefusesTruncatedAndTrailingBytes) {
  std::vector<std::uint8_t> bytes = encode_network(neighbourhood_sum(2));
  for (std::size_t size = 0; size < bytes.size(); ++size)
    EXPECT_THROW(decode_network(std::span(bytes).first(size)), std::invalid_argument) << size;
  bytes.push_back(0);
  EXPECT_THROW(decode_network(bytes), std::invalid_argument);
}

TEST(FloatNetworkFile, NeverCrashesOnDamagedBytes) {
  const std::vector<std::uint8_t> good = encode_network(neighbourhood_sum(2));
  std::mt19937 random(5);
  for (int i = 0; i < 2000; ++i) {
    std::vector<std::uint8_t> bytes = good;
    for (int k = 0; k < 3; ++k)
      bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
    try {
      decode_network(bytes);
    } catch (const std::invalid_argument&) {
    }
  }
}

TEST(FloatNetworkFile, SaysWhichFileIsMissing) {
  EXPECT_THAT([] { load_network("/nonexistent/x.fnet"); },
              ThrowsMessage<std::runtime_error>(HasSubstr("/nonexistent/x.fnet")));
}

}  // namespace
}  // namespace ivfm::host

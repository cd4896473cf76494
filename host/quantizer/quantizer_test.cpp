// Golden tests: the firmware's int8 network against the float network it was made from.
#include "host/quantizer/quantizer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>
#include <random>

#include "firmware/nn/kernels_tiled.h"
#include "firmware/nn/q_network.h"
#include "host/quantizer/activation_memory.h"
#include "host/quantizer/float_q_function.h"

namespace ivfm::host {
namespace {

using testing::ElementsAreArray;
using testing::HasSubstr;
using testing::ThrowsMessage;

std::unique_ptr<QNetwork> loaded(std::span<const std::uint8_t> file,
                                 const KernelSet& kernels = fast_kernels()) {
  auto network = std::make_unique<QNetwork>(kernels);
  const ModelStatus status = network->load(file);
  EXPECT_EQ(status.status, Status::kOk) << status.reason;
  return network;
}

// Every set of kernels that this processor can run.
std::vector<const KernelSet*> runnable_kernels() {
  std::vector<const KernelSet*> sets = {&reference_kernels(), &portable_kernels(), &fast_kernels()};
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2")) sets.push_back(&avx2_kernels());
#endif
  return sets;
}

// A graph with every layer kind at sizes that need every tile: 1 x 1 to 32 x 32, 16 to 48 channels.
FloatNetwork make_odd_network(std::uint64_t seed) {
  NetworkBuilder b(StateKind::kIvfm, "odd");
  int x = b.conv3x3(NetworkBuilder::kInput, 16, 2);
  const int skip = b.conv1x1(x, 48);
  for (const int outputs : {32, 48, 64, 16}) x = b.conv3x3(x, outputs, 2);
  x = b.conv3x3(x, 48);
  for (int i = 0; i < 4; ++i) x = b.conv3x3(b.upsample2x(x), 48);
  x = b.add(skip, b.conv1x1(x, 48, false), false);
  x = b.add(x, skip);  // a sum that may be negative, then ReLU
  FloatNetwork network = b.finish(b.conv3x3(b.upsample2x(b.conv1x1(x, 16)), 16));
  randomize(network, seed);
  return network;
}

TEST(QuantizedUnet18, StaysWithinTheLimitsOfTheSmallestTarget) {
  const FloatNetwork network = make_random_network(1);
  const auto file = quantize(network, make_example_states(1, 4));
  const auto int8 = loaded(file);
  EXPECT_LE(int8->model().weight_bytes, 400'000u);
  EXPECT_LE(int8->model().tensor_bytes + kScratchBytes, 96u * 1024);
  EXPECT_LE(int8->model().multiply_adds, 50'000'000);
  EXPECT_STREQ(int8->model().name.data(), "unet18");
}

TEST(Quantize, AnswersTheSameBytesEveryTime) {
  const FloatNetwork network = make_random_network(2);
  const auto states = make_example_states(2, 4);
  EXPECT_EQ(quantize(network, states), quantize(network, states));
}

TEST(Quantize, KeepsTheValuesOfRandomNetworks) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const FloatNetwork network = make_random_network(seed);
    const auto file = quantize(network, make_example_states(seed, 16));
    const QuantizationReport report = compare(network, file, make_example_states(seed + 100, 32));
    EXPECT_GT(report.correlation, 0.995) << seed;
    EXPECT_GE(report.near_best, 0.8) << seed;  // random values: many ties within the rounding
    EXPECT_LT(report.worst_loss, 0.1) << seed;
  }
}

TEST(Quantize, ChoosesAsTheFloatNetworkOfTheSameWeights) {
  FloatNetwork network = make_random_network(5);
  round_weights(network);
  const auto file = quantize(network, make_example_states(5, 16));
  const QuantizationReport report = compare(network, file, make_example_states(6, 64));
  EXPECT_GT(report.correlation, 0.99999);
  EXPECT_GE(report.near_best_value, 0.99);
}

TEST(RoundWeights, ChangesNothingOnceDone) {
  FloatNetwork network = make_random_network(5);
  const std::vector<float> before = network.layers[0].weights;
  round_weights(network);
  const std::vector<float> rounded = network.layers[0].weights;
  EXPECT_NE(rounded, before);
  round_weights(network);
  for (std::size_t i = 0; i < rounded.size(); ++i)
    EXPECT_FLOAT_EQ(network.layers[0].weights[i], rounded[i]);
}

TEST(Quantize, KeepsTheScaleOfTheValues) {
  const FloatNetwork network = make_random_network(7);
  const auto states = make_example_states(7, 8);
  const auto file = quantize(network, states);
  const auto int8 = loaded(file);
  const double scale = std::bit_cast<float>(int8->model().output_scale_f32_bits);
  FloatRunner runner(network);
  const auto state = std::span(states).first(2 * kPolicyGridSize);
  const auto expected = runner.run(state);
  const auto actual = int8->run(state);
  double error = 0, size = 0;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    error += std::abs(expected[i] - scale * actual[i]);
    size += std::abs(expected[i]);
  }
  EXPECT_LT(error, 0.1 * size);
}

TEST(Quantize, HandlesEveryStateKind) {
  for (const StateKind kind : {StateKind::kIvfm, StateKind::kVfm, StateKind::kFoldedIvfm}) {
    const FloatNetwork network = make_random_network(8, kind);
    const auto states = make_example_states(8, 8, kind);
    EXPECT_GT(compare(network, quantize(network, states), states).correlation, 0.99);
  }
}

TEST(Quantize, HandlesChannelsWithoutWeights) {
  FloatNetwork network = make_random_network(9);
  FloatLayer& layer = network.layers[2];
  std::fill_n(layer.weights.begin(), layer.weights.size() / 2, 0.0f);  // 16 of 32 channels
  layer.bias[0] = 3.0f;
  const auto states = make_example_states(9, 8);
  EXPECT_GT(compare(network, quantize(network, states), states).correlation, 0.99);
}

TEST(Quantize, SaysWhatDoesNotFit) {
  const FloatNetwork network = make_random_network(1);
  EXPECT_THAT([&] { quantize(network, std::vector<std::uint16_t>(100)); },
              ThrowsMessage<std::invalid_argument>(HasSubstr("2048 values each")));
  NetworkBuilder b(StateKind::kIvfm, "too large");
  int x = NetworkBuilder::kInput;
  for (int i = 0; i < 3; ++i) x = b.conv3x3(x, 128);
  FloatNetwork large = b.finish(x);
  randomize(large, 1);
  EXPECT_THAT([&] { quantize(large, make_example_states(1, 1)); },
              ThrowsMessage<std::runtime_error>(HasSubstr("too much memory")));
  NetworkBuilder twelve(StateKind::kIvfm, "12 channels");
  FloatNetwork narrow = twelve.finish(twelve.conv3x3(NetworkBuilder::kInput, 12));
  randomize(narrow, 1);
  EXPECT_THAT([&] { quantize(narrow, make_example_states(1, 1)); },
              ThrowsMessage<std::runtime_error>(HasSubstr("multiple of 16")));
}

TEST(Kernels, AnswerTheSameBitsInEverySet) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed)
    for (const FloatNetwork& network : {make_random_network(seed), make_odd_network(seed)}) {
      const auto file = quantize(network, make_example_states(seed, 4));
      const auto states = make_example_states(seed + 50, 4);
      const auto reference = loaded(file, reference_kernels());
      for (const KernelSet* kernels : runnable_kernels()) {
        const auto other = loaded(file, *kernels);
        for (std::size_t i = 0; i < 4; ++i) {
          const auto state =
              std::span(states).subspan(i * 2 * kPolicyGridSize, 2 * kPolicyGridSize);
          const auto expected = reference->run(state);
          ASSERT_THAT(other->run(state), ElementsAreArray(expected)) << kernels->name;
        }
      }
    }
}

TEST(Kernels, AgreeOnRandomStatesThatNoEncoderWrites) {
  const auto file = quantize(make_odd_network(11), make_example_states(11, 4));
  std::mt19937 random(12);
  std::vector<std::uint16_t> state(2 * kPolicyGridSize);
  const auto reference = loaded(file, reference_kernels());
  const auto fast = loaded(file);
  for (int i = 0; i < 5; ++i) {
    for (auto& v : state) v = static_cast<std::uint16_t>(random());
    const auto expected = reference->run(state);
    ASSERT_THAT(fast->run(state), ElementsAreArray(expected));
  }
}

TEST(QNetwork, AnswersNothingWithoutAModelOrWithAWrongState) {
  const auto network = std::make_unique<QNetwork>();
  std::vector<std::uint16_t> state(2 * kPolicyGridSize);
  EXPECT_TRUE(network->run(state).empty());
  const auto file = quantize(make_random_network(1), make_example_states(1, 1));
  ASSERT_EQ(network->load(file).status, Status::kOk);
  EXPECT_EQ(network->run(state).size(), 1024u);
  EXPECT_TRUE(network->run(std::span(state).first(1024)).empty());
  EXPECT_EQ(network->load({}).status, Status::kTruncated);
  EXPECT_TRUE(network->run(state).empty());
}

TEST(FloatQFunction, OrdersThePolicyCellsAsTheNetworkDoes) {
  const FloatNetwork network = make_random_network(1);
  LocalState state;
  const auto example = make_example_states(1, 1);
  std::copy(example.begin(), example.end(), state.channels.begin());
  FloatRunner runner(network);
  const auto values = runner.run(example);
  FloatQFunction function(network);
  std::vector<std::int32_t> q(kPolicyGridSize);
  ASSERT_EQ(function.evaluate(state, q), Status::kOk);
  for (std::size_t i = 1; i < q.size(); ++i)
    EXPECT_EQ(q[i] < q[i - 1], values[i] < values[i - 1]) << i;
  EXPECT_NEAR(1.0 * q[5] / function.unit(), values[5], 1e-6);
  EXPECT_EQ(function.evaluate(state, std::span(q).first(1)), Status::kInvalidArgument);
  EXPECT_THROW(FloatQFunction(make_unet18(StateKind::kFoldedIvfm)), std::invalid_argument);
}

TEST(PlanActivations, ReusesMemoryAndKeepsSkips) {
  const FloatNetwork network = make_unet18();
  const ActivationPlan plan = plan_activations(network);
  EXPECT_LE(plan.bytes, 80u * 1024);  // 32 x 32 x 16 twice, and the 16 x 16 features
  EXPECT_GE(plan.bytes, 2u * 32 * 1024);
}

}  // namespace
}  // namespace ivfm::host

#include "firmware/nn/q_network.h"

#include <gtest/gtest.h>

#include <memory>
#include <set>
#include <vector>

#include "firmware/nn/kernels_tiled.h"
#include "firmware/nn/test_model.h"
#include "shared/wire/crc.h"

namespace ivfm {
namespace {

// Runs every test with each set of kernels that this processor has.
class QNetworkTest : public testing::TestWithParam<const KernelSet*> {
 protected:
  std::span<const std::int32_t> run(const TestModel& model) {
    file_ = model.bytes();
    network_ = std::make_unique<QNetwork>(*GetParam());
    const ModelStatus status = network_->load(file_);
    EXPECT_EQ(status.status, Status::kOk) << status.reason;
    return network_->run(state_);
  }
  void set(int channel, int x, int y, std::uint16_t value) {
    state_[static_cast<std::size_t>(1024 * channel + 32 * y + x)] = value;
  }

  std::vector<std::uint16_t> state_ = std::vector<std::uint16_t>(2 * kPolicyGridSize, 0);
  std::vector<std::uint8_t> file_;
  std::unique_ptr<QNetwork> network_;
};

std::vector<const KernelSet*> runnable_kernels() {
  std::vector<const KernelSet*> sets = {&reference_kernels(), &portable_kernels()};
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2")) sets.push_back(&avx2_kernels());
#endif
  if (&fast_kernels() != sets.back()) sets.push_back(&fast_kernels());
  return sets;
}

INSTANTIATE_TEST_SUITE_P(Kernels, QNetworkTest, testing::ValuesIn(runnable_kernels()),
                         [](const auto& test) {
                           std::string name = test.param->name;
                           std::erase(name, '-');
                           return name;
                         });

TEST_P(QNetworkTest, AddsUpAStrideTwoConvolutionByHand) {
  TestModel model;
  // Output 5 of the stride 2 convolution: 1..9 over channel 0. The head doubles it.
  for (int tap = 0; tap < 9; ++tap) model.weight(0, 5, tap, 0) = static_cast<std::int8_t>(tap + 1);
  model.layers[0].bias[5] = 3;
  model.weight(4, 0, 0, 5) = 2;
  model.layers[4].bias[0] = -1;
  model.inputs[0] = {0, 2, 1};  // the state's value itself
  set(0, 3, 2, 1);              // seen by half-grid cells (1, 1) and (2, 1)
  set(0, 31, 31, 2);            // seen by (15, 15) only
  const auto q = run(model);
  // Cell (1, 1) reads columns 1..3 and rows 1..3: the pixel is its tap (row 1, column 2), weight 6.
  EXPECT_EQ(q[2 * 32 + 2], 2 * (6 + 3) - 1);
  EXPECT_EQ(q[3 * 32 + 3], 2 * (6 + 3) - 1);
  // Cell (2, 1) reads columns 3..5: tap (row 1, column 0), weight 4.
  EXPECT_EQ(q[2 * 32 + 4], 2 * (4 + 3) - 1);
  // Cell (15, 15) reads columns 29..31: tap (row 2, column 2), weight 9.
  EXPECT_EQ(q[31 * 32 + 31], 2 * (2 * 9 + 3) - 1);
  EXPECT_EQ(q[0], 2 * 3 - 1);
}

TEST_P(QNetworkTest, RoundsHalvesUpAndClamps) {
  TestModel model;
  model.layers[2].shift = 31;  // q = accumulator / 2
  model.weight(2, 0, 0, 0) = 1;
  model.weight(2, 1, 0, 0) = -1;
  model.layers[2].bias[1] = 4;
  model.weight(4, 0, 0, 0) = 1;
  model.weight(4, 0, 0, 1) = 100;
  model.inputs[0] = {0, 2, 1};
  set(0, 0, 0, 3);      // 3 / 2 -> 2;  (4 - 3) / 2 -> 1
  set(0, 1, 0, 5);      // 5 / 2 -> 3;  (4 - 5) / 2 -> 0
  set(0, 2, 0, 40000);  // clamped to 16383: 8192;  ReLU: 0
  const auto q = run(model);
  EXPECT_EQ(q[0], 2 + 100);
  EXPECT_EQ(q[1], 3);
  EXPECT_EQ(q[2], 8192);
  EXPECT_EQ(q[3], 200);
}

TEST_P(QNetworkTest, ScalesBothOperandsOfAnAddition) {
  TestModel model;
  model.layers[3].shift = 14;
  model.layers[3].multiplier_a = 1 << 13;        // half of the upsampled one
  model.layers[3].multiplier_b = 3 * (1 << 13);  // one and a half of the other
  model.weight(0, 2, 4, 0) = 1;                  // the middle pixel of channel 0
  model.weight(2, 2, 0, 1) = 1;                  // channel 1
  model.weight(4, 0, 0, 2) = 1;
  model.inputs = {{0, 2, 1}, {0, 2, 1}};
  set(0, 4, 6, 10);  // half-grid cell (2, 3): grid cells (4..5, 6..7)
  set(1, 4, 6, 7);
  set(1, 5, 7, 12000);
  const auto q = run(model);
  EXPECT_EQ(q[6 * 32 + 4], 16);  // 5 + 10.5 = 15.5
  EXPECT_EQ(q[6 * 32 + 5], 5);
  EXPECT_EQ(q[7 * 32 + 5], kMaxActivation);  // 5 + 18000
  EXPECT_EQ(q[6 * 32 + 6], 0);
}

TEST_P(QNetworkTest, QuantizesItsInputs) {
  TestModel model;
  model.inputs = {{20480, 9362, 14}, {16640, -16131, 14}};  // 16383 / 28672 and -16383 / 16640
  model.weight(2, 0, 0, 0) = 1;
  model.weight(2, 1, 0, 1) = 1;
  model.weight(4, 0, 0, 0) = 1;
  model.weight(4, 0, 0, 1) = 127;
  const std::uint16_t ivfm[] = {20480, 49152, 29944, 0};
  const std::uint16_t path[] = {0, 16384, 65535, 8320};
  for (int x = 0; x < 4; ++x) {
    set(0, x, 0, ivfm[x]);
    set(1, x, 0, path[x]);
  }
  const auto q = run(model);
  EXPECT_EQ(q[0], 0 + 127 * 16383);
  EXPECT_EQ(q[1], 16383 + 127 * 252);  // blocked: 28672 * 9362 / 2^14 = 16383.5; 252.1
  EXPECT_EQ(q[2], 5408);               // 9464 * 9362 / 2^14 = 5407.8; out of reach
  EXPECT_EQ(q[3], 0 + 127 * 8192);     // clamped at 0; half way
}

// Pseudo-random weights, the same on every machine.
TestModel make_noisy_model() {
  TestModel model;
  std::uint32_t seed = 1;
  const auto next = [&seed] { return seed = seed * 1664525u + 1013904223u, seed >> 16; };
  for (auto& layer : model.layers) {
    for (auto& w : layer.weights)
      w = static_cast<std::int8_t>(static_cast<int>(next() % 255) - 127);
    for (auto& b : layer.bias) b = static_cast<std::int32_t>(next()) - 32768;
    if (layer.shift == 30)
      for (auto& m : layer.multipliers) m = static_cast<std::int32_t>(next() * 32);
  }
  model.inputs = {{20480, 9362, 14}, {16640, -16131, 14}};
  return model;
}

TEST_P(QNetworkTest, AnswersTheSameBitsOnEveryMachine) {
  for (std::size_t i = 0; i < state_.size(); ++i)
    state_[i] = static_cast<std::uint16_t>(i * 40503u >> 3);
  const auto q = run(make_noisy_model());
  std::vector<std::uint8_t> bytes;
  for (const std::int32_t v : q)
    for (int shift = 0; shift < 32; shift += 8)
      bytes.push_back(static_cast<std::uint8_t>(static_cast<std::uint32_t>(v) >> shift));
  // Pinned from the reference kernels on x86-64.
  EXPECT_GT(std::set<std::int32_t>(q.begin(), q.end()).size(), 500u);
  EXPECT_EQ(crc32(bytes), 0x4aa63373u);
}

TEST_P(QNetworkTest, AnswersAsAQFunction) {
  TestModel model;
  model.layers[4].bias[0] = 42;
  run(model);
  LocalState state{};
  std::vector<std::int32_t> q(kPolicyGridSize);
  EXPECT_EQ(network_->evaluate(state, q), Status::kOk);
  EXPECT_EQ(q, std::vector<std::int32_t>(kPolicyGridSize, 42));
  EXPECT_EQ(network_->evaluate(state, std::span(q).first(7)), Status::kInvalidArgument);
  EXPECT_EQ(QNetwork().evaluate(state, q), Status::kUnavailable);
}

TEST(QNetwork, SaysWhatItsValuesMean) {
  const auto unit_at = [](float scale) {
    TestModel model;
    model.output_scale_bits = std::bit_cast<std::uint32_t>(scale);
    const std::vector<std::uint8_t> file = model.bytes();
    const auto network = std::make_unique<QNetwork>();
    EXPECT_EQ(network->load(file).status, Status::kOk);
    return network->unit();
  };
  EXPECT_EQ(unit_at(1), 1);
  EXPECT_EQ(unit_at(0.25), 4);
  EXPECT_EQ(unit_at(1e-4f), 10'000);
  EXPECT_EQ(unit_at(3), 0) << "too coarse to say";
  EXPECT_EQ(unit_at(1e-20f), 0) << "too fine";
  EXPECT_EQ(QNetwork().unit(), 0);
}

TEST(QNetwork, ForgetsAModelThatFailsToLoad) {
  const std::vector<std::uint8_t> file = TestModel().bytes();
  const auto network = std::make_unique<QNetwork>();
  std::vector<std::uint16_t> state(2 * kPolicyGridSize);
  EXPECT_TRUE(network->run(state).empty());
  ASSERT_EQ(network->load(file).status, Status::kOk);
  EXPECT_EQ(network->run(state).size(), 1024u);
  EXPECT_TRUE(network->run(std::span(state).first(1024)).empty());
  EXPECT_EQ(network->load(std::span(file).first(100)).status, Status::kTruncated);
  EXPECT_TRUE(network->run(state).empty());
}

TEST(QNetwork, RefusesOnARobotWhatIsForAnotherState) {
  const auto network = std::make_unique<QNetwork>();
  const std::vector<std::uint8_t> good = TestModel().bytes();
  EXPECT_EQ(network->load_for_robot(good).status, Status::kOk);
  EXPECT_TRUE(network->has_model());
  TestModel vfm;
  vfm.state_kind = static_cast<std::uint8_t>(StateKind::kVfm);
  vfm.input_channels = vfm.tensors[0].channels = 4;
  vfm.inputs.resize(4, {0, 1, 1});
  const std::vector<std::uint8_t> file = vfm.bytes();
  ASSERT_EQ(network->load(file).status, Status::kOk) << "ivfm-train compare takes it";
  EXPECT_EQ(network->load_for_robot(file).status, Status::kUnsupported);
  EXPECT_FALSE(network->has_model());
}

}  // namespace
}  // namespace ivfm

#include "host/trainer/learner.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>
#include <sstream>

#include "firmware/nn/q_network.h"
#include "host/quantizer/quantizer.h"
#include "host/trainer/symmetry.h"

namespace ivfm::host {
namespace {

constexpr std::size_t kStateSize = 2 * kActions;  // of the state on board

Observation random_observation(ResumableRandom& random) {
  Observation o;
  for (std::size_t i = 0; i < kActions; ++i) {
    o.state[i] = static_cast<std::uint16_t>(20480 + random.below(28673));
    o.state[kActions + i] = static_cast<std::uint16_t>(random.below(16385));
    if (random.below(10) == 0) o.state[kActions + i] = kPathUnreachable;
    if (o.state[kActions + i] != kPathUnreachable) o.reachable.set(static_cast<int>(i));
  }
  return o;
}

// A small network, so that tests that train take seconds.
FloatNetwork small_network(std::uint64_t seed) {
  NetworkBuilder b(StateKind::kIvfm, "small");
  const int low = b.conv3x3(b.conv3x3(NetworkBuilder::kInput, 16), 16, 2);
  const int up = b.upsample2x(b.conv1x1(low, 16, false));
  FloatNetwork network = b.finish(b.add(up, b.conv1x1(NetworkBuilder::kInput, 16)));
  randomize(network, seed);
  return network;
}

TEST(TorchNetwork, AgreesWithTheReferenceRunOfTheSameWeights) {
  const FloatNetwork network = make_random_network(11);
  LearnerConfig config;
  config.bfloat16 = false;
  Learner learner(network, config);
  FloatRunner reference(network);
  ResumableRandom random(3);
  const Observation a = random_observation(random), b = random_observation(random);
  const Observation* both[] = {&a, &b};
  const std::vector<float> q = learner.q_values(both);
  for (std::size_t n = 0; n < 2; ++n) {
    const std::span<const float> expected =
        reference.run(std::span(both[n]->state).first(kStateSize));
    for (std::size_t i = 0; i < kActions; ++i)
      ASSERT_NEAR(q[n * kActions + i], expected[i], 1e-4f) << "state " << n << " cell " << i;
  }
}

TEST(TorchNetwork, GivesItsWeightsBackUnchanged) {
  const FloatNetwork network = make_random_network(5);
  EXPECT_EQ(encode_network(TorchNetwork(network).to_float_network()), encode_network(network));
}

TEST(Learner, NeverChoosesAGoalOutOfReach) {
  ResumableRandom random(9);
  Observation o = random_observation(random);
  o.reachable = {};
  o.reachable.set(500);
  const Observation nothing;
  const Observation* both[] = {&o, &nothing};
  EXPECT_EQ(Learner(small_network(1), {}).best_actions(both), (std::vector<int>{500, -1}));
}

// The label of a goal is the i-VFM value there, so the Q map is the state.
LabelBuffer bandit(std::size_t states, ResumableRandom& random) {
  LabelBuffer labels(states);
  for (std::size_t i = 0; i < states; ++i) {
    LabelledState sample;
    sample.observation = random_observation(random);
    for (int a = static_cast<int>(random.below(3)); a < kActions; a += 3) {
      sample.actions.push_back(a);
      sample.values.push_back(sample.observation.state[static_cast<std::size_t>(a)] / 49152.0f);
    }
    labels.add(sample);
  }
  return labels;
}

class EachArithmetic : public testing::TestWithParam<Arithmetic> {};

TEST_P(EachArithmetic, LearnsTheLabels) {
  ResumableRandom random(21);
  const LabelBuffer labels = bandit(200, random);
  LearnerConfig config;
  config.learning_rate = 3e-3;
  config.batch = 16;
  config.bfloat16 = GetParam() == Arithmetic::kBfloat16;
  const FloatNetwork network = small_network(2);
  Learner learner(network, config);
  if (GetParam() == Arithmetic::kQuantized) learner.round_weights();
  double first = 0, last = 0;
  for (int i = 0; i < 200; ++i) {
    const double loss = learner.learn(labels, random);
    if (i < 10) first += loss;
    if (i >= 190) last += loss;
  }
  EXPECT_LT(last, 0.1 * first);
}

INSTANTIATE_TEST_SUITE_P(Learner, EachArithmetic,
                         testing::Values(Arithmetic::kFloat, Arithmetic::kBfloat16,
                                         Arithmetic::kQuantized));

// Quantization-aware training is worth something only when it rounds as the robot does.
TEST(TorchNetwork, RoundsAsTheInt8Network) {
  const FloatNetwork network = small_network(7);  // deep ones amplify last bits
  const std::vector<std::uint16_t> states = make_example_states(1, 40);
  LearnerConfig config;
  config.bfloat16 = false;
  Learner exact(network, config), rounding(network, config);
  rounding.round_weights();
  const std::vector<std::uint8_t> model = quantize(rounding.to_float_network(), states);
  const auto int8 = std::make_unique<QNetwork>();
  ASSERT_EQ(int8->load(model).status, Status::kOk);
  const double scale = std::bit_cast<float>(int8->model().output_scale_f32_bits);
  double float_error = 0, rounded_error = 0;
  for (std::size_t n = 0; n < 40; ++n) {
    Observation o;
    const auto state = std::span(states).subspan(n * kStateSize, kStateSize);
    std::ranges::copy(state, o.state.begin());
    const Observation* one[] = {&o};
    const std::vector<float> floats = exact.q_values(one), rounded = rounding.q_values(one);
    const std::span<const std::int32_t> actual = int8->run(state);
    for (std::size_t i = 0; i < kActions; ++i) {
      const double q = actual[i] * scale;
      float_error += std::abs(q - static_cast<double>(floats[i]));
      rounded_error += std::abs(q - static_cast<double>(rounded[i]));
    }
  }
  EXPECT_LT(rounded_error, 0.1 * float_error);
}

TEST(Learner, ValuesAStateByItsBestGoalInReach) {
  ResumableRandom random(4);
  Observation o = random_observation(random);
  const Observation* one[] = {&o};
  Learner learner(small_network(4), {});
  const std::vector<float> q = learner.q_values(one);
  o.reachable = {};
  o.reachable.set(40);
  EXPECT_EQ(learner.state_values(one), std::vector<float>{q[40]});
  o.reachable.set(41);
  EXPECT_EQ(learner.state_values(one), std::vector<float>{std::max(q[40], q[41])});
  o.reachable = {};
  EXPECT_EQ(learner.state_values(one), std::vector<float>{0.0f});
}

TEST(Learner, ContinuesIdenticallyFromACheckpoint) {
  ResumableRandom random(8);
  const LabelBuffer labels = bandit(50, random);
  const auto losses = [&](Learner& learner, ResumableRandom& r, int steps) {
    std::vector<double> out;
    for (int i = 0; i < steps; ++i) out.push_back(learner.learn(labels, r));
    return out;
  };
  Learner learner(small_network(1), {});
  losses(learner, random, 5);
  torch::serialize::OutputArchive saved;
  learner.save(saved);
  std::stringstream file;
  saved.save_to(file);
  const std::uint64_t seed = random.state();
  const std::vector<double> uninterrupted = losses(learner, random, 5);

  Learner resumed(small_network(77), {});
  torch::serialize::InputArchive archive;
  archive.load_from(file);
  resumed.load(archive);
  ResumableRandom again(seed);
  EXPECT_EQ(losses(resumed, again, 5), uninterrupted);
}

}  // namespace
}  // namespace ivfm::host

#include "host/trainer/learner.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <sstream>

#include "host/trainer/symmetry.h"

namespace ivfm::host {
namespace {

Observation random_observation(ResumableRandom& random) {
  Observation o;
  for (std::size_t i = 0; i < kActions; ++i) {
    o.state[i] = static_cast<std::uint16_t>(20480 + random.below(28673));
    o.state[kActions + i] = static_cast<std::uint16_t>(random.below(16385));
    if (random.below(10) == 0) o.state[kActions + i] = kUnreachablePath;
    if (o.state[kActions + i] != kUnreachablePath) o.reachable.set(static_cast<int>(i));
  }
  return o;
}

// A small network, so that tests that train take seconds.
FloatNetwork small_network(std::uint64_t seed) {
  NetworkBuilder b(StateKind::kIvfm, "small");
  const int low = b.conv3x3(b.conv3x3(NetworkBuilder::kInput, 8), 8, 2);
  const int up = b.upsample2x(b.conv1x1(low, 8, false));
  FloatNetwork network = b.finish(b.add(up, b.conv1x1(NetworkBuilder::kInput, 8)));
  randomize(network, seed);
  return network;
}

TEST(TorchNetwork, AgreesWithTheReferenceRunOfTheSameWeights) {
  const FloatNetwork network = make_random_network(11);
  Learner learner(network, {});
  FloatRunner reference(network);
  ResumableRandom random(3);
  const Observation a = random_observation(random), b = random_observation(random);
  const Observation* both[] = {&a, &b};
  const std::vector<float> q = learner.q_values(both);
  for (std::size_t n = 0; n < 2; ++n) {
    const std::span<const float> expected = reference.run(both[n]->state);
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

// A bandit: the reward of a goal is the i-VFM value there. One step, so the Q map is the state.
TEST(Learner, LearnsAOneStepBandit) {
  ResumableRandom random(21);
  ReplayBuffer replay(200, 2000);
  for (int i = 0; i < 200; ++i) {
    const Observation o = random_observation(random);
    const ObservationId id = replay.add(o);
    for (int k = 0; k < 10; ++k) {
      const auto action = static_cast<std::int32_t>(random.below(kActions));
      const float value = o.state[static_cast<std::size_t>(action)] / 49152.0f;
      replay.add(Transition{id, kNoObservation, action, value, 0});
    }
  }
  LearnerConfig config;
  config.learning_rate = 3e-3;
  config.batch = 16;
  config.siblings = 5;
  Learner learner(small_network(2), config);
  double first = 0, last = 0;
  for (int i = 0; i < 200; ++i) {
    const double loss = learner.learn(replay, random);
    if (i < 10) first += loss;
    if (i >= 190) last += loss;
  }
  EXPECT_LT(last, 0.1 * first);
}

// A corridor of two states: the first earns nothing but leads to the second, which earns 1.
TEST(Learner, PassesValueBackThroughTheMaskedTarget) {
  Observation first, second;
  first.state.fill(20480);
  second.state.fill(49152);
  second.state[kActions + 700] = 0;  // tells the network this cell from the others
  first.reachable.set(40);
  second.reachable.set(200);
  ReplayBuffer replay(2, 100);
  const ObservationId a = replay.add(first), b = replay.add(second);
  replay.add(Transition{a, b, 40, 0.0f, 0.5f});
  replay.add(Transition{b, kNoObservation, 200, 1.0f, 0});
  // An action out of reach looks better; the target must not follow it.
  replay.add(Transition{b, kNoObservation, 700, 5.0f, 0});
  LearnerConfig config;
  config.batch = 6;
  config.learning_rate = 3e-3;
  config.target_rate = 0.05;
  config.symmetries = false;
  Learner learner(small_network(4), config);
  ResumableRandom random(5);
  for (int i = 0; i < 200; ++i) learner.learn(replay, random);
  const Observation* both[] = {&first, &second};
  const std::vector<float> q = learner.q_values(both);
  EXPECT_NEAR(q[kActions + 200], 1.0f, 0.1f);
  EXPECT_NEAR(q[40], 0.5f, 0.1f);
}

TEST(Learner, ImitatesLabels) {
  ResumableRandom random(31);
  std::vector<LabelledState> labelled(200);
  for (LabelledState& sample : labelled) {
    sample.observation = random_observation(random);
    for (int a = 0; a < kActions; a += 3) {
      sample.actions.push_back(a);
      sample.values.push_back(sample.observation.state[static_cast<std::size_t>(a)] / 49152.0f);
    }
  }
  LearnerConfig config;
  config.learning_rate = 3e-3;
  config.batch = 16;
  Learner learner(small_network(2), config);
  double first = learner.imitate(labelled, random), last = 0;
  for (int i = 0; i < 200; ++i) last = learner.imitate(labelled, random);
  EXPECT_LT(last, 0.1 * first);
}

TEST(Learner, ContinuesIdenticallyFromACheckpoint) {
  ResumableRandom random(8);
  ReplayBuffer replay(50, 50);
  for (int i = 0; i < 50; ++i) {
    const ObservationId id = replay.add(random_observation(random));
    if (id > 0) replay.add(Transition{id - 1, id, i, static_cast<float>(i % 3), 0.9f});
  }
  const auto losses = [&](Learner& learner, ResumableRandom& r, int steps) {
    std::vector<double> out;
    for (int i = 0; i < steps; ++i) out.push_back(learner.learn(replay, r));
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

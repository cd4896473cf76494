#include "host/trainer/trainer.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>

namespace ivfm::host {
namespace {

// A run of seconds: tiny batches, two episodes at a time, an evaluation at the end.
TrainerConfig tiny_config(const std::string& name) {
  TrainerConfig c;
  c.out = testing::TempDir() + "trainer_test_" + name;
  std::filesystem::remove_all(c.out);
  c.steps = 6;
  c.one_move_steps = 2;
  c.quantized_steps = 2;
  c.environments = 2;
  c.threads = 2;
  c.labels = 2;
  c.states_per_step = 2;
  c.replay_states = 8;
  c.report_every = 1;
  c.checkpoint_every = 3;
  c.evaluate_every = 1000;
  c.evaluation_episodes = 1;
  c.learner.batch = 2;
  return c;
}

std::string content(const std::string& path) {
  std::ifstream in(path);
  return {std::istreambuf_iterator<char>(in), {}};
}

const std::atomic<bool> kNever{false};

TEST(Trainer, ContinuesFromACheckpointWithTheSameLosses) {
  const TrainerConfig whole = tiny_config("whole"), parts = tiny_config("parts");
  EXPECT_TRUE(Trainer(whole, [](const std::string&) {}).run(kNever));
  std::atomic<bool> stop{false};
  Trainer first(parts, [&](const std::string& line) { stop = line.starts_with("step 3 of 6"); });
  EXPECT_FALSE(first.run(stop));
  EXPECT_EQ(first.step(), 3);
  Trainer second(parts, [](const std::string&) {});
  EXPECT_EQ(second.step(), 3);
  EXPECT_TRUE(second.run(kNever));
  EXPECT_EQ(content(parts.out + "/curves.csv"), content(whole.out + "/curves.csv"));
}

// A run that is shorter than the time between evaluations, too.
TEST(Trainer, EvaluatesAtItsEndAndExportsAModelFile) {
  TrainerConfig config = tiny_config("export");
  config.steps = 3;
  Trainer trainer(config, [](const std::string&) {});
  EXPECT_TRUE(trainer.run(kNever));
  EXPECT_TRUE(std::filesystem::exists(config.out + "/best.fnet"));
  EXPECT_NE(content(config.out + "/curves.svg").find("steps_1x"), std::string::npos);
  trainer.export_model();
  EXPECT_GT(std::filesystem::file_size(config.out + "/model.ivfm"), 100'000u);
}

TEST(Trainer, RefusesADamagedCheckpointAndAFolderItCannotWrite) {
  TrainerConfig config = tiny_config("damaged");
  std::filesystem::create_directories(config.out);
  std::ofstream(config.out + "/checkpoint.pt") << "not a checkpoint";
  EXPECT_THROW(Trainer(config, [](const std::string&) {}), std::runtime_error);
  config.out += "/checkpoint.pt/below-a-file";
  EXPECT_THROW(Trainer(config, [](const std::string&) {}), std::runtime_error);
}

// 400 map cells of a paper arena are 100 policy cells (2 x 2 each): one unit of reward.
TEST(Reward, CountsPolicyCellsDistanceAndMishaps) {
  TrainerConfig config;
  config.reward = {.unit_cells = 100,
                   .re_seen = 0.5,
                   .per_action = 0.25,
                   .per_cell = 0.125,
                   .collision = 4,
                   .idle = 8};
  config.arena_discount = {0.5, 0.25};
  const ExplorationEnvironment arena(EnvironmentConfig::arena());
  StepResult result;
  result.newly_seen_cells = 400;
  result.re_seen_penalty_cells = 80;  // 20 policy cells: 0.5 * 0.2
  result.distance_m = 0.25;           // 8 policy cells
  const Earning earning = earning_of(result, arena, config);
  EXPECT_DOUBLE_EQ(earning.reward, 1.0 - 0.1 - 0.25 - 1.0);
  EXPECT_DOUBLE_EQ(earning.discount, 0.5 * 0.25);
  result.collided = true;
  EXPECT_DOUBLE_EQ(earning_of(result, arena, config).reward, -0.35 - 4);
  result.collided = false;
  result.idle = true;
  EXPECT_DOUBLE_EQ(earning_of(result, arena, config).reward, -0.35 - 8);
}

TEST(Evaluation, PlaysEveryEpisodeToItsEnd) {
  const auto first_goal = [](std::span<const Observation* const> observations) {
    std::vector<int> out;
    for (const Observation* o : observations) {
      int a = 0;
      while (a < kActions - 1 && !o->reachable.test(a)) ++a;
      out.push_back(a);
    }
    return out;
  };
  const Evaluation e = evaluate_arena({StateKind::kIvfm, first_goal}, ArenaKind::k1x, 2, 3, 4);
  EXPECT_EQ(e.episodes, 3);
  EXPECT_LE(e.not_found, 3);
  if (e.not_found < 3) {
    EXPECT_GE(e.steps, 1);
    EXPECT_LE(e.steps, 8);
  }
}

}  // namespace
}  // namespace ivfm::host

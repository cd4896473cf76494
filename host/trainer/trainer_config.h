// Every option of a training run, with its name in the TOML file, its flag and its meaning.
#pragma once

#include <cstdint>
#include <string>
#include <type_traits>

#include "host/trainer/learner_config.h"

namespace ivfm::host {

// Shares of the streams of episodes, so of the states; they need not sum to 1.
struct WorldMix {
  double arena_1x = 1.0;
  double arena_2x = 0.0;
  double divider = 0.0;
  double divider_released = 0.0;
  double building = 0.0;
  double corridor = 0.0;            // buildings where the network decides alone
  int max_agents = 1;               // each episode draws 1 .. max_agents
  double building_min_range_m = 2;  // lidar range, drawn for every building
  double building_max_range_m = 4;
  double building_min_side_m = 8;
  double building_max_side_m = 16;
};

// In units of `unit_cells` newly seen policy cells, so that every world and sensor counts alike.
struct RewardConfig {
  double unit_cells = 100;
  double re_seen = 0.2;           // times (2 sigma(count) - 1), for each re-seen policy cell
  double building_re_seen = 0.2;  // the same in buildings, where only metres count
  double corridor_re_seen = 0.2;  // the same where the network decides alone in a building
  double per_action = 0.0;        // cost of an action
  double per_cell = 0.0;          // cost of driving one policy cell's side
  double collision = 0.5;         // cost of a contact
  double idle = 2.0;              // cost of an action that did not move the robot
};

// What the future counts less for: a factor for each action, and one for each 8 policy cells driven
// (0.25 m in the arenas).
struct DiscountConfig {
  double action = 0.9;
  double distance = 1.0;
};

struct TrainerConfig {
  std::string out = "out/train";
  std::string state = "ivfm";  // what the network sees
  std::string init;            // .fnet to start from instead of random weights
  std::uint64_t seed = 1;
  int threads = 1;
  bool fresh = false;  // ignore a checkpoint in `out`

  int steps = 20'000;
  int one_move_steps = 0;   // at the start: goals are worth their own reward only
  int quantized_steps = 0;  // at the end: with weights rounded to int8

  int environments = 16;
  int labels = 24;                    // goals tried in every state
  double states_per_step = 4;         // new ones for each step of learning
  std::size_t replay_states = 6'000;  // remembered

  double learning_rate_end = 1e-4;
  DiscountConfig arena_discount{0.9, 1.0};
  DiscountConfig building_discount{0.98, 0.9};
  double epsilon_start = 0.3;
  double epsilon_end = 0.05;
  int epsilon_steps = 5'000;
  double temperature = 0.1;  // of the softmax over Q that picks likely goals; 0: the best

  int report_every = 100;
  int evaluate_every = 1'000;
  int evaluation_episodes = 100;
  int checkpoint_every = 1'000;

  WorldMix worlds;
  RewardConfig reward;
  LearnerConfig learner;
};

// Calls `visit(name, reference, help)` for every option; `name` is "table.key" in the file and
// --table.key on the command line. One list for files, flags and the copy kept beside a run.
template <typename Config, typename Visit>
void visit_options(Config& c, Visit&& visit) {
  visit("run.out", c.out, "folder for checkpoints, curves and networks");
  visit("run.state", c.state, "what the network sees: ivfm, vfm or folded (network_state.h)");
  visit("run.init", c.init, "network file (.fnet) to start from; empty: random weights");
  visit("run.seed", c.seed, "seed of weights, worlds and choices");
  visit("run.threads", c.threads, "processor threads");
  visit("run.fresh", c.fresh, "start anew even when the folder holds a checkpoint");
  visit("run.steps", c.steps, "steps of learning in all");
  visit("run.one_move_steps", c.one_move_steps, "first of them, with goals worth their own reward");
  visit("run.quantized_steps", c.quantized_steps, "last of them, with weights rounded to int8");
  visit("run.report_every", c.report_every, "steps between rows of the curves");
  visit("run.evaluate_every", c.evaluate_every, "steps between evaluations");
  visit("run.evaluation_episodes", c.evaluation_episodes, "episodes of an evaluation");
  visit("run.checkpoint_every", c.checkpoint_every, "steps between checkpoints");
  visit("worlds.arena_1x", c.worlds.arena_1x, "share of 3 x 3 m arenas");
  visit("worlds.arena_2x", c.worlds.arena_2x, "share of 4.2 x 4.2 m arenas");
  visit("worlds.divider", c.worlds.divider, "share of arenas with the paper's strip");
  visit("worlds.divider_released", c.worlds.divider_released, "share with the released strip");
  visit("worlds.building", c.worlds.building, "share of generated buildings with a lidar");
  visit("worlds.corridor", c.worlds.corridor, "share where the network decides alone in them");
  visit("worlds.max_agents", c.worlds.max_agents, "robots of an episode, at most");
  visit("worlds.building_min_range_m", c.worlds.building_min_range_m, "shortest lidar range");
  visit("worlds.building_max_range_m", c.worlds.building_max_range_m, "longest lidar range");
  visit("worlds.building_min_side_m", c.worlds.building_min_side_m, "smallest building");
  visit("worlds.building_max_side_m", c.worlds.building_max_side_m, "largest building");
  visit("reward.unit_cells", c.reward.unit_cells, "newly seen policy cells that earn 1");
  visit("reward.re_seen", c.reward.re_seen, "weight of the penalty for seeing cells again");
  visit("reward.building_re_seen", c.reward.building_re_seen, "the same, in buildings");
  visit("reward.corridor_re_seen", c.reward.corridor_re_seen, "the same, as worlds.corridor");
  visit("reward.per_action", c.reward.per_action, "cost of an action");
  visit("reward.per_cell", c.reward.per_cell, "cost of driving one policy cell's side");
  visit("reward.collision", c.reward.collision, "cost of a contact");
  visit("reward.idle", c.reward.idle, "cost of an action that does not move the robot");
  visit("learning.batch", c.learner.batch, "states of a step");
  visit("learning.rate", c.learner.learning_rate, "learning rate at the start");
  visit("learning.rate_end", c.learning_rate_end, "learning rate at the end (cosine between)");
  visit("learning.weight_decay", c.learner.weight_decay, "decoupled weight decay");
  visit("learning.gradient_clip", c.learner.gradient_clip, "largest norm of the gradient");
  visit("learning.shared_weight", c.learner.shared_weight, "of errors that a state's goals share");
  visit("learning.target_rate", c.learner.target_rate, "share of the weights the target takes");
  visit("learning.double_q", c.learner.double_q, "the online network picks the target's goal");
  visit("learning.mask_target", c.learner.mask_target, "targets leave out unreachable goals");
  visit("learning.symmetries", c.learner.symmetries, "show samples under random symmetries");
  visit("learning.bfloat16", c.learner.bfloat16, "16-bit arithmetic with 32-bit weights");
  visit("discount.arena_action", c.arena_discount.action, "of an action, in arenas");
  visit("discount.arena_distance", c.arena_discount.distance, "of 8 policy cells, in arenas");
  visit("discount.building_action", c.building_discount.action, "of an action, in buildings");
  visit("discount.building_distance", c.building_discount.distance, "of 8 policy cells, there");
  visit("collect.environments", c.environments, "episodes that run side by side");
  visit("collect.labels", c.labels, "goals tried in every state");
  visit("collect.states_per_step", c.states_per_step, "new states for each step of learning");
  visit("collect.replay_states", c.replay_states, "states remembered (4 KiB each)");
  visit("collect.epsilon_start", c.epsilon_start, "share of random actions at the start");
  visit("collect.epsilon_end", c.epsilon_end, "share of random actions later");
  visit("collect.epsilon_steps", c.epsilon_steps, "steps from the one to the other");
  visit("collect.temperature", c.temperature, "softmax temperature of likely goals; 0: the best");
}

// Reads a TOML file into `config`; options it does not name keep their values. Throws
// std::runtime_error with file, line and reason: syntax, unknown option, wrong type.
void load_config(const std::string& path, TrainerConfig& config);

// The configuration as a TOML file's text.
std::string to_toml(const TrainerConfig& config);

// Throws std::invalid_argument naming the option that is out of range.
void check(const TrainerConfig& config);

}  // namespace ivfm::host

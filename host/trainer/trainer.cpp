#include "host/trainer/trainer.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <numbers>
#include <span>
#include <stdexcept>

#include "host/quantizer/quantizer.h"
#include "host/trainer/atomic_file.h"
#include "host/trainer/learner.h"

namespace ivfm::host {
namespace {

constexpr double kEmpty = std::numeric_limits<double>::quiet_NaN();
constexpr double kNoScore = -1e9;
constexpr int kCalibrationStates = 512;
constexpr int kEvaluationCap = 150;  // actions per agent

FloatNetwork first_network(const TrainerConfig& config) {
  const StateKind kind = state_kind_from_name(config.state).value();
  if (config.init.empty()) return make_random_network(config.seed, kind);
  FloatNetwork network = load_network(config.init);
  if (network.state_kind != kind)
    throw std::runtime_error(config.init + ": not a network for run.state = " + config.state);
  return network;
}

// States to try goals in before the first step of learning.
std::size_t first_states(const TrainerConfig& config) {
  return std::min<std::size_t>(config.replay_states,
                               40 * static_cast<std::size_t>(config.environments));
}

// One number that grows with a better policy: the paper's three aims, each as a share of the goal
// (20 steps, RER 0.25, PE 7,000), and a penalty for targets not found.
double score_of(const Evaluation& e) {
  return -e.steps / 20 - 0.5 * e.re_exploration_rate / 0.25 + e.pixels_per_metre / 7000 -
         10.0 * e.not_found / std::max(1, e.episodes);
}

std::string text_of(const Evaluation& e) {
  char line[160];
  std::snprintf(line, sizeof line,
                "steps %.2f RER %.3f PE %.0f collisions %.2f coverage %.3f not found %d/%d",
                e.steps, e.re_exploration_rate, e.pixels_per_metre, e.collisions, e.coverage,
                e.not_found, e.episodes);
  return line;
}

torch::Tensor word(std::uint64_t value) {
  return torch::tensor({static_cast<std::int64_t>(value)}, torch::kInt64);
}

std::uint64_t read_word(torch::serialize::InputArchive& archive, const char* key) {
  torch::Tensor value;
  archive.read(key, value);
  return static_cast<std::uint64_t>(value.item<std::int64_t>());
}

}  // namespace

Trainer::Trainer(const TrainerConfig& config, Report report)
    : config_(config),
      report_(std::move(report)),
      random_(config.seed),
      learner_(std::make_unique<Learner>(first_network(config), config.learner)),
      labels_(config.replay_states),
      collector_(config_) {
  torch::set_num_threads(config.threads);
  if (!config_.fresh && std::filesystem::exists(path("checkpoint.pt"))) load_checkpoint();
  write_atomically(path("config.toml"), [this](const std::string& temporary) {
    std::ofstream(temporary) << to_toml(config_);
  });
  curves_ = std::make_unique<CurveLog>(
      path("curves.csv"),
      std::vector<std::string>{"loss", "reward", "learning_rate", "epsilon", "steps_1x", "rer_1x",
                               "pe_1x", "not_found_1x", "score"},
      step_);
}

Trainer::~Trainer() = default;

bool Trainer::run(const std::atomic<bool>& stop) {
  collector_.restart(random_);
  if (labels_.size() == 0) fill(first_states(config_), stop);
  while (!stop && step_ < config_.steps) {
    begin_phase(stop);
    learn_once();
    if (step_ % config_.report_every == 0) report_progress(loss_sum_ / losses_);
    if (step_ % config_.evaluate_every == 0 || step_ == config_.steps) evaluate();
    if (step_ % config_.checkpoint_every == 0 && step_ < config_.steps) {
      save_checkpoint();
      collector_.restart(random_);  // a resumed run does the same
    }
  }
  if (saved_step_ != step_) save_checkpoint();
  curves_->plot(path("curves.svg"));
  return step_ >= config_.steps;
}

// What changes when one way of learning follows another.
void Trainer::begin_phase(const std::atomic<bool>& stop) {
  if (step_ > 0 && step_ == config_.one_move_steps) {
    report_("from here on goals are worth what follows them, too");
    learner_->copy_to_target();
    labels_.clear();
    fill(first_states(config_), stop);
  }
  if (!is_quantized()) return;
  if (step_ == config_.steps - config_.quantized_steps) {
    report_("from here on the weights are rounded to int8");
    best_score_ = kNoScore;
  }
  learner_->round_weights();
}

void Trainer::fill(std::size_t states, const std::atomic<bool>& stop) {
  report_("trying " + std::to_string(config_.labels) + " goals in each of " +
          std::to_string(states) + " states");
  while (labels_.size() < states && !stop) collect();
  owed_states_ = 0;
}

void Trainer::collect() {
  const QValues q_values = [this](std::span<const Observation* const> observations) {
    return learner_->q_values(observations);
  };
  const StateValues state_values = [this](std::span<const Observation* const> observations) {
    return looks_ahead() ? learner_->state_values(observations)
                         : std::vector<float>(observations.size(), 0.0f);
  };
  for (LabelledState& state : collector_.collect(q_values, state_values, epsilon())) {
    labels_.add(std::move(state));
    owed_states_ -= 1;
  }
}

void Trainer::learn_once() {
  const auto begin = std::chrono::steady_clock::now();
  for (owed_states_ += config_.states_per_step; owed_states_ > 0;) collect();
  learner_->set_learning_rate(learning_rate());
  loss_sum_ += learner_->learn(labels_, random_);
  ++losses_;
  ++step_;
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  step_seconds_ += 0.02 * (took.count() - step_seconds_);
}

void Trainer::report_progress(double loss) {
  const double reward = collector_.take_mean_reward();
  curves_->add(step_,
               {loss, reward, learning_rate(), epsilon(), kEmpty, kEmpty, kEmpty, kEmpty, kEmpty});
  char line[160];
  std::snprintf(line, sizeof line,
                "step %ld of %d, loss %.4f, reward %.3f, %.0f ms a step, %.0f min to go", step_,
                config_.steps, loss, reward, step_seconds_ * 1e3,
                step_seconds_ * static_cast<double>(config_.steps - step_) / 60);
  report_(line);
  loss_sum_ = losses_ = 0;
}

Policy Trainer::policy() {
  return {state_kind_from_name(config_.state).value(),
          [this](std::span<const Observation* const> observations) {
            return learner_->best_actions(observations);
          },
          config_.threads};
}

void Trainer::evaluate() {
  const Evaluation arena =
      evaluate_arena(policy(), ArenaKind::k1x, 1, config_.evaluation_episodes, kEvaluationCap);
  const double score = score_of(arena);
  curves_->add(step_, {kEmpty, kEmpty, kEmpty, kEmpty, arena.steps, arena.re_exploration_rate,
                       arena.pixels_per_metre, static_cast<double>(arena.not_found), score});
  curves_->plot(path("curves.svg"));
  report_("validation 1x: " + text_of(arena));
  save_network("last.fnet");
  if (score <= best_score_) return;
  best_score_ = score;
  save_network("best.fnet");
}

void Trainer::save_network(const std::string& name) const {
  write_atomically(path(name), [this](const std::string& temporary) {
    host::save_network(learner_->to_float_network(), temporary);
  });
}

void Trainer::save_checkpoint() {
  const std::string labels_name = "labels-" + std::to_string(step_) + ".bin";
  write_atomically(path(labels_name), [this](const std::string& temporary) {
    std::ofstream out(temporary, std::ios::binary);
    labels_.save(out);
    if (!out.flush()) throw std::runtime_error("disk full or folder not writable");
  });
  write_atomically(path("checkpoint.pt"), [this](const std::string& temporary) {
    torch::serialize::OutputArchive archive;
    learner_->save(archive);
    archive.write("step", word(static_cast<std::uint64_t>(step_)));
    archive.write("random", word(random_.state()));
    archive.write("owed_states", torch::tensor({owed_states_}, torch::kFloat64));
    archive.write("best_score", torch::tensor({best_score_}, torch::kFloat64));
    archive.save_to(temporary);
  });
  for (const auto& file : std::filesystem::directory_iterator(config_.out)) {
    const std::string name = file.path().filename().string();
    if (name.starts_with("labels-") && name != labels_name) std::filesystem::remove(file.path());
  }
  saved_step_ = step_;
}

void Trainer::load_checkpoint() {
  try {
    torch::serialize::InputArchive archive;
    archive.load_from(path("checkpoint.pt"));
    learner_->load(archive);
    step_ = static_cast<long>(read_word(archive, "step"));
    random_.set_state(read_word(archive, "random"));
    torch::Tensor value;
    archive.read("owed_states", value);
    owed_states_ = value.item<double>();
    archive.read("best_score", value);
    best_score_ = value.item<double>();
  } catch (const c10::Error& e) {
    throw std::runtime_error(path("checkpoint.pt") +
                             ": not a checkpoint of this network; --fresh starts anew");
  }
  std::ifstream in(path("labels-" + std::to_string(step_) + ".bin"), std::ios::binary);
  if (!in) throw std::runtime_error(config_.out + ": the checkpoint's labels are missing");
  labels_.load(in);
  saved_step_ = step_;
  report_("continuing from step " + std::to_string(step_));
}

double Trainer::epsilon() const {
  const double share =
      config_.epsilon_steps <= 0 ? 1.0 : static_cast<double>(step_) / config_.epsilon_steps;
  return config_.epsilon_start +
         (config_.epsilon_end - config_.epsilon_start) * std::min(1.0, share);
}

double Trainer::learning_rate() const {
  const double progress = static_cast<double>(step_) / std::max(1, config_.steps);
  const double high = config_.learner.learning_rate, low = config_.learning_rate_end;
  return low + (high - low) * 0.5 * (1 + std::cos(std::numbers::pi * progress));
}

// States of the remembered ones, one after the other.
std::vector<std::uint16_t> Trainer::example_states(int count) {
  ResumableRandom random(config_.seed);
  const int size = channels_of(state_kind_from_name(config_.state).value()) * kActions;
  std::vector<std::uint16_t> examples;
  for (int i = 0; i < count; ++i) {
    const State& s = labels_[random.below(labels_.size())].observation.state;
    examples.insert(examples.end(), s.begin(), s.begin() + size);
  }
  return examples;
}

void Trainer::export_model() {
  const bool has_best = std::filesystem::exists(path("best.fnet"));
  const FloatNetwork network = load_network(path(has_best ? "best.fnet" : "last.fnet"));
  learner_->load_weights(network);
  const std::vector<std::uint16_t> examples = example_states(kCalibrationStates);
  const std::vector<std::uint8_t> model = quantize(network, examples);
  const QuantizationReport report = compare(network, model, examples);
  write_atomically(path("model.ivfm"), [&](const std::string& temporary) {
    std::ofstream out(temporary, std::ios::binary);
    out.write(reinterpret_cast<const char*>(model.data()),
              static_cast<std::streamsize>(model.size()));
    if (!out.flush()) throw std::runtime_error("disk full or folder not writable");
  });
  char line[200];
  std::snprintf(line, sizeof line,
                "quantized: %zu bytes, correlation %.4f, same goal %.1f %%, as good %.1f %%",
                model.size(), report.correlation, 100 * report.same_best, 100 * report.near_best);
  report_(line);
}

}  // namespace ivfm::host

// A training run: fitted double Q-learning on goals tried in copies; curves, checkpoints, networks.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "host/trainer/collector.h"
#include "host/trainer/curve_log.h"
#include "host/trainer/evaluation.h"
#include "host/trainer/label_buffer.h"
#include "host/trainer/trainer_config.h"

namespace ivfm::host {

class Learner;

// Writes into config.out:
//   config.toml      the run's options
//   curves.csv/.svg  loss, reward and validation scores
//   checkpoint.pt    everything needed to go on (with labels-<step>.bin)
//   best.fnet        the network with the best validation score; last.fnet the newest
//   model.ivfm       best.fnet in int8
class Trainer {
 public:
  // One line about the run's progress.
  using Report = std::function<void(const std::string&)>;

  // Continues from config.out/checkpoint.pt when it is there, unless config.fresh. Throws
  // std::runtime_error for files that cannot be read or written.
  Trainer(const TrainerConfig& config, Report report);
  ~Trainer();

  // Trains until all steps are done or `stop` is set; a checkpoint is written either way. Answers
  // whether all steps are done.
  bool run(const std::atomic<bool>& stop);
  // Quantizes best.fnet (else last.fnet) on states of fresh episodes.
  void export_model();

  long step() const { return step_; }

 private:
  bool looks_ahead() const { return step_ >= config_.one_move_steps; }
  bool is_quantized() const { return step_ >= config_.steps - config_.quantized_steps; }
  void collect();
  void fill(std::size_t states, const std::atomic<bool>& stop);
  void begin_phase(const std::atomic<bool>& stop);
  void learn_once();
  std::vector<std::uint16_t> example_states(int count);
  void report_progress(double loss);
  void evaluate();
  void save_network(const std::string& name) const;
  void save_checkpoint();
  void load_checkpoint();
  double epsilon() const;
  double learning_rate() const;
  Policy policy();
  std::string path(const std::string& name) const { return config_.out + "/" + name; }

  TrainerConfig config_;
  Report report_;
  ResumableRandom random_;
  std::unique_ptr<Learner> learner_;
  LabelBuffer labels_;
  Collector collector_;
  std::unique_ptr<CurveLog> curves_;
  long step_ = 0;
  double owed_states_ = 0;  // to be collected before the next step
  double best_score_ = -1e9;
  double loss_sum_ = 0;
  int losses_ = 0;
  long saved_step_ = -1;  // step of the checkpoint on disk
  double step_seconds_ = 0;
};

}  // namespace ivfm::host

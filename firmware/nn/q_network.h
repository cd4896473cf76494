// The Q-network: state in, one value a policy cell out, in fixed memory and integers only.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "firmware/nn/kernels.h"
#include "firmware/nn/model_view.h"
#include "firmware/nn/q_function.h"
#include "firmware/nn/state_encoder.h"

namespace ivfm {

class QNetwork final : public QFunction {
 public:
  // `kernels` only changes how fast it is.
  explicit QNetwork(const KernelSet& kernels = fast_kernels()) : kernels_(&kernels) {}

  // Takes over `file`, which must outlive the network or the next load(). Codes as load_model();
  // after a failure there is no model.
  ModelStatus load(std::span<const std::uint8_t> file);
  // The same for the state that robots encode, LocalState: a model for another is kUnsupported.
  ModelStatus load_for_robot(std::span<const std::uint8_t> file);
  bool has_model() const { return has_model_; }
  // Requires has_model().
  const ModelView& model() const { return model_; }

  // The values of the 1024 policy cells, accumulators of the head: larger is better, and
  // Q = value * model().output_scale. `state`: the channels one after the other, as the encoder
  // writes them. Valid until the next call. Empty without a model or with a wrong size.
  std::span<const std::int32_t> run(std::span<const std::uint16_t> state);

  // run() as a QFunction. kUnavailable: no model; kInvalidArgument: the model is for another kind
  // of state, or `q_values` has not kPolicyGridSize values.
  Status evaluate(const LocalState& state, std::span<std::int32_t> q_values) override;

  // The reciprocal of the model's output scale.
  std::int32_t unit() const override { return unit_; }

  const char* kernel_name() const { return kernels_->name; }

 private:
  std::int16_t* tensor(std::size_t index) {
    return tensors_.data() + model_.tensors[index].offset / sizeof(std::int16_t);
  }
  void quantize_state(std::span<const std::uint16_t> state);
  void run_layer(const LayerView& layer);

  const KernelSet* kernels_;
  bool has_model_ = false;
  std::int32_t unit_ = 0;
  ModelView model_;
  alignas(64) std::array<std::int16_t, kTensorMemoryBytes / sizeof(std::int16_t)> tensors_;
  alignas(64) std::array<std::int16_t, kScratchBytes / sizeof(std::int16_t)> scratch_;
  std::array<std::int32_t, kPolicyGridSize> values_;
};

}  // namespace ivfm

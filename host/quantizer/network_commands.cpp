#include "host/quantizer/network_commands.h"

#include <cstdio>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

#include "firmware/nn/q_network.h"
#include "host/quantizer/float_q_function.h"
#include "host/quantizer/onnx_file.h"
#include "host/quantizer/quantizer.h"
#include "host/quantizer/recorded_states.h"
#include "host/quantizer/robot_model.h"

namespace ivfm::host {

namespace {

struct Options {
  std::string network;  // .fnet
  std::string model;    // .ivfm
  std::string onnx;
  std::string rounded;  // .fnet
  int states = 0;
  std::uint64_t seed = 1;
  bool json = false;
};

int export_onnx(const Options& options) {
  save_onnx(load_network(options.network), options.onnx);
  return 0;
}

int quantize_network(const Options& options) {
  FloatNetwork network = load_network(options.network);
  if (!options.rounded.empty()) {
    round_weights(network);
    save_network(network, options.rounded);
  }
  FloatQFunction q(network);
  const RecordedStates recorded = record_states(q, options.states, options.seed);
  const std::vector<std::uint8_t> model = quantize(network, recorded.states);
  std::ofstream out(options.model, std::ios::binary);
  out.write(reinterpret_cast<const char*>(model.data()),
            static_cast<std::streamsize>(model.size()));
  if (!out.flush()) throw std::runtime_error("cannot write " + options.model);
  std::printf("%s: %zu bytes\n", options.model.c_str(), model.size());
  return 0;
}

int compare_networks(const Options& options) {
  const std::vector<std::uint8_t> model = read_model_file(options.model);
  const auto int8 = std::make_unique<QNetwork>();
  if (const ModelStatus status = int8->load(model); !ok(status.status))
    throw std::runtime_error(options.model + ": " + status.reason);
  const RecordedStates recorded = record_states(*int8, options.states, options.seed);
  const QuantizationReport r =
      compare(load_network(options.network), model, recorded.states, recorded.masks);
  if (options.json) {
    const nlohmann::ordered_json json = {{"states", r.states},
                                         {"same_goal", r.same_best},
                                         {"within_1_percent_of_best_q", r.near_best_value},
                                         {"within_1_percent_of_spread", r.near_best},
                                         {"worst_loss_of_spread", r.worst_loss},
                                         {"correlation", r.correlation}};
    std::printf("%s\n", json.dump(2).c_str());
    return 0;
  }
  std::printf(
      "int8 against float on %zu recorded states, among the goals that could be chosen:\n"
      "  same goal                              %6.2f %%\n"
      "  or float Q within 1 %% of the best Q    %6.2f %%\n"
      "  or float Q within 1 %% of the spread    %6.2f %%\n"
      "  worst choice loses                     %6.2f %% of the spread\n"
      "  correlation of all values              %8.4f\n",
      r.states, 100 * r.same_best, 100 * r.near_best_value, 100 * r.near_best, 100 * r.worst_loss,
      r.correlation);
  return 0;
}

}  // namespace

void add_network_commands(CLI::App& app, CommandAction& action) {
  const auto add = [&](const char* name, const char* help, int states, int (*run)(const Options&)) {
    auto options = std::make_shared<Options>();
    options->states = states;
    CLI::App* command = app.add_subcommand(name, help);
    command->add_option("network", options->network, "float network (.fnet)")->required();
    command->callback(
        [options, run, &action] { action = [options, run] { return run(*options); }; });
    if (states == 0) {
      command->add_option("onnx", options->onnx, "file to write")->required();
      return command;
    }
    command->add_option("model", options->model, "int8 network (.ivfm)")->required();
    command->add_option("--states", options->states, "recorded states of fresh episodes")
        ->check(CLI::Range(6, 1'000'000))
        ->capture_default_str();
    command->add_option("--seed", options->seed, "of the episodes")->capture_default_str();
    if (run == compare_networks) command->add_flag("--json", options->json, "one JSON object");
    if (run == quantize_network)
      command->add_option("--rounded", options->rounded,
                          "round the float network's weights to int8 first, and write it here");
    return command;
  };
  add("export", "Write a float network as ONNX", 0, export_onnx)
      ->footer("Example: ivfm-train export models/ivfm-unet18.fnet ivfm-unet18.onnx");
  add("quantize", "Quantize a float network to the robot's model file", 512, quantize_network)
      ->footer("Example: ivfm-train quantize out/train/best.fnet model.ivfm");
  add("compare", "How often the int8 network chooses as the float network does", 10'000,
      compare_networks)
      ->footer("Example: ivfm-train compare models/ivfm-unet18.fnet models/ivfm-unet18.ivfm");
}

}  // namespace ivfm::host

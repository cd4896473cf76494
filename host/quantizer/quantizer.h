// Post-training quantization: a float network and example states in, the firmware's model file out.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "host/quantizer/float_network.h"

namespace ivfm::host {

// Quantizes: weights to int8, symmetric per output channel; activations to 14 bits, symmetric per
// tensor, with room for half as much again as the largest value in `states`.
// `states`: example states one after the other (each: channels * 1024 values), a few hundred of the
// kind that the network will meet. Throws std::invalid_argument when the network or the states do
// not fit, and std::runtime_error with the limit that the model would exceed.
std::vector<std::uint8_t> quantize(const FloatNetwork& network,
                                   std::span<const std::uint16_t> states);

// Rounds the weights to the int8 steps that quantize() gives them: the float network that the robot
// has, but for its activations. Networks learn with their weights rounded so (see the trainer).
void round_weights(FloatNetwork& network);

// How close a model file comes to its float network on some states.
struct QuantizationReport {
  std::size_t states = 0;
  double correlation = 0;      // of all values of a state, mean over the states
  double same_best = 0;        // share of states in which both choose the same goal
  double near_best_value = 0;  // or int8 one whose float value is within 1 % of the best's size
  double near_best = 0;        // or within 1 % of the spread of the float values
  double worst_loss = 0;  // largest loss of float value by the int8 choice, share of the spread
};
// `masks`: which policy cells can be goals, 1024 a state; empty: all. Throws as quantize(), and
// std::runtime_error when the firmware refuses `model`.
QuantizationReport compare(const FloatNetwork& network, std::span<const std::uint8_t> model,
                           std::span<const std::uint16_t> states,
                           std::span<const std::uint8_t> masks = {});

// Made-up states for tests and benchmarks: rooms, visited strips, distances. Same layout as above.
std::vector<std::uint16_t> make_example_states(std::uint64_t seed, int count,
                                               StateKind kind = StateKind::kIvfm);

}  // namespace ivfm::host

#include "host/quantizer/activation_memory.h"

#include <algorithm>
#include <numeric>

namespace ivfm::host {
namespace {

// One place in memory: a tensor, or several that replace each other. In use from the layer that
// writes it to the layer that reads it last, both included.
struct Place {
  std::uint32_t bytes = 0;
  int first = 0;
  int last = 0;
  std::uint32_t offset = 0;
};

std::uint32_t align(std::uint32_t bytes) { return (bytes + 63) / 64 * 64; }

int last_use(const FloatNetwork& network, int tensor) {
  int last = tensor - 1;  // the layer that makes it
  for (std::size_t i = 0; i < network.layers.size(); ++i)
    if (network.layers[i].input_a == tensor || network.layers[i].input_b == tensor)
      last = static_cast<int>(i);
  return last;
}

// The lowest offset at which `place` is clear of the `placed` ones that are in use with it.
std::uint32_t lowest_offset(const Place& place, std::vector<Place> placed) {
  std::erase_if(placed,
                [&](const Place& p) { return p.last < place.first || p.first > place.last; });
  std::sort(placed.begin(), placed.end(),
            [](const Place& a, const Place& b) { return a.offset < b.offset; });
  std::uint32_t offset = 0;
  for (const Place& p : placed) {
    if (offset + place.bytes <= p.offset) break;
    offset = std::max(offset, p.offset + p.bytes);
  }
  return offset;
}

}  // namespace

ActivationPlan plan_activations(const FloatNetwork& network) {
  const std::vector<Shape> shapes = network.shapes();
  const std::size_t tensors = network.layers.size();  // the head's output is not kept
  std::vector<Place> places;
  std::vector<std::size_t> place_of(tensors);
  for (std::size_t t = 0; t < tensors; ++t) {
    const int last = last_use(network, static_cast<int>(t)), first = static_cast<int>(t) - 1;
    if (t > 0 && network.layers[t - 1].kind == LayerKind::kAdd) {
      const auto a = static_cast<std::size_t>(network.layers[t - 1].input_a);
      const auto b = static_cast<std::size_t>(network.layers[t - 1].input_b);
      const bool replaces_b = places[place_of[b]].last == first;
      if (replaces_b || places[place_of[a]].last == first) {
        place_of[t] = place_of[replaces_b ? b : a];
        places[place_of[t]].last = last;
        continue;
      }
    }
    const auto stored = static_cast<std::size_t>((shapes[t].channels + 3) / 4 * 4);
    const std::size_t pixels = shapes[t].size() / static_cast<std::size_t>(shapes[t].channels);
    place_of[t] = places.size();
    const std::size_t bytes = pixels * stored * sizeof(std::int16_t);
    places.push_back({align(static_cast<std::uint32_t>(bytes)), first, last, 0});
  }
  std::vector<std::size_t> order(places.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return places[a].bytes > places[b].bytes; });
  ActivationPlan plan;
  std::vector<Place> placed;
  for (const std::size_t i : order) {
    places[i].offset = lowest_offset(places[i], placed);
    placed.push_back(places[i]);
    plan.bytes = std::max(plan.bytes, places[i].offset + places[i].bytes);
  }
  for (std::size_t t = 0; t < tensors; ++t) plan.offsets.push_back(places[place_of[t]].offset);
  return plan;
}

}  // namespace ivfm::host

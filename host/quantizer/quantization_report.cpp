#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <stdexcept>

#include "firmware/nn/q_network.h"
#include "host/quantizer/quantizer.h"

namespace ivfm::host {
namespace {

double correlation(std::span<const float> a, std::span<const std::int32_t> b) {
  const auto n = static_cast<double>(a.size());
  double mean_a = 0, mean_b = 0, aa = 0, bb = 0, ab = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    mean_a += static_cast<double>(a[i]) / n;
    mean_b += static_cast<double>(b[i]) / n;
  }
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double da = static_cast<double>(a[i]) - mean_a, db = b[i] - mean_b;
    aa += da * da;
    bb += db * db;
    ab += da * db;
  }
  return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 1;
}

// Adds to the sums whether int8 chooses as float does, among the cells of `mask` (empty: all).
void add_choices(QuantizationReport& sums, std::span<const float> expected,
                 std::span<const std::int32_t> actual, std::span<const std::uint8_t> mask) {
  std::ptrdiff_t best = -1, chosen = -1;
  double lowest = 0;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    if (!mask.empty() && mask[i] == 0) continue;
    const auto at = static_cast<std::ptrdiff_t>(i);
    lowest = best < 0 ? double{expected[i]} : std::min(lowest, double{expected[i]});
    if (best < 0 || expected[i] > expected[static_cast<std::size_t>(best)]) best = at;
    if (chosen < 0 || actual[i] > actual[static_cast<std::size_t>(chosen)]) chosen = at;
  }
  if (best < 0) throw std::invalid_argument("a mask without any goal");
  const double highest = expected[static_cast<std::size_t>(best)];
  const double lost = highest - double{expected[static_cast<std::size_t>(chosen)]};
  const double spread = std::max(1e-9, highest - lowest);
  sums.same_best += lost == 0 ? 1 : 0;
  sums.near_best_value += lost <= 0.01 * std::abs(highest) ? 1 : 0;
  sums.near_best += lost <= 0.01 * spread ? 1 : 0;
  sums.worst_loss = std::max(sums.worst_loss, lost / spread);
}

// Fills the values of one made-up state: a few walls and strips already seen, straight distances.
class ExampleDrawer {
 public:
  explicit ExampleDrawer(std::uint64_t seed) : random_(seed) {}

  void draw(std::span<std::uint16_t> ivfm, std::span<std::uint16_t> path) {
    std::fill(ivfm.begin(), ivfm.end(), kIvfmOfVisits[0]);
    for (int i = 0; i < kPolicyGridSize; ++i) {
      const int dx = i % 32 - 16, dy = i / 32 - 16;
      path[static_cast<std::size_t>(i)] =
          static_cast<std::uint16_t>(std::lround(256 * std::sqrt(dx * dx + dy * dy)));
    }
    for (int n = below(12); n > 0; --n) draw_seen(ivfm);
    for (int n = below(8); n > 0; --n) draw_wall(ivfm, path);
    ivfm[16 * 32 + 16] = kIvfmBlocked;
  }

 private:
  int below(int limit) { return static_cast<int>(random_() % static_cast<std::uint64_t>(limit)); }

  void draw_seen(std::span<std::uint16_t> ivfm) {
    const int x0 = below(28), y0 = below(28), width = 3 + below(14), height = 3 + below(14);
    const std::uint16_t value = kIvfmOfVisits[static_cast<std::size_t>(1 + below(3))];
    for (int y = y0; y < std::min(32, y0 + height); ++y)
      for (int x = x0; x < std::min(32, x0 + width); ++x)
        ivfm[static_cast<std::size_t>(32 * y + x)] = value;
  }

  void draw_wall(std::span<std::uint16_t> ivfm, std::span<std::uint16_t> path) {
    const bool along_x = below(2) == 0;
    const int x0 = below(32), y0 = below(32), length = 3 + below(20);
    for (int i = 0; i < length; ++i) {
      const int x = x0 + (along_x ? i : 0), y = y0 + (along_x ? 0 : i);
      if (x > 31 || y > 31) break;
      ivfm[static_cast<std::size_t>(32 * y + x)] = kIvfmBlocked;
      path[static_cast<std::size_t>(32 * y + x)] = kPathUnreachable;
    }
  }

  std::mt19937_64 random_;
};

}  // namespace

QuantizationReport compare(const FloatNetwork& network, std::span<const std::uint8_t> model,
                           std::span<const std::uint16_t> states,
                           std::span<const std::uint8_t> masks) {
  const std::size_t state_size = network.inputs.size() * kPolicyGridSize;
  if (states.empty() || states.size() % state_size != 0)
    throw std::invalid_argument("no states, or of the wrong size");
  const auto int8 = std::make_unique<QNetwork>();
  if (const ModelStatus status = int8->load(model); !ok(status.status))
    throw std::runtime_error(std::string("bad model: ") + status.reason);
  FloatRunner floats(network);
  QuantizationReport report;
  report.states = states.size() / state_size;
  if (!masks.empty() && masks.size() != report.states * kPolicyGridSize)
    throw std::invalid_argument("as many masks as states");
  for (std::size_t i = 0; i < report.states; ++i) {
    const auto state = states.subspan(i * state_size, state_size);
    const auto expected = floats.run(state);
    const auto actual = int8->run(state);
    if (actual.empty()) throw std::runtime_error("the model is for another kind of state");
    const auto mask = masks.empty() ? masks : masks.subspan(i * kPolicyGridSize, kPolicyGridSize);
    report.correlation += correlation(expected, actual);
    add_choices(report, expected, actual, mask);
  }
  const double share = 1.0 / static_cast<double>(report.states);
  for (double* sum :
       {&report.correlation, &report.same_best, &report.near_best_value, &report.near_best})
    *sum *= share;
  return report;
}

std::vector<std::uint16_t> make_example_states(std::uint64_t seed, int count, StateKind kind) {
  const auto channels = static_cast<std::size_t>(channels_of(kind));
  std::vector<std::uint16_t> states(static_cast<std::size_t>(count) * channels * kPolicyGridSize);
  std::vector<std::uint16_t> unused(kPolicyGridSize);
  ExampleDrawer drawer(seed);
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    const auto state =
        std::span(states).subspan(i * channels * kPolicyGridSize, channels * kPolicyGridSize);
    drawer.draw(state.first(kPolicyGridSize),
                channels == 1 ? std::span(unused) : state.last(kPolicyGridSize));
  }
  return states;
}

}  // namespace ivfm::host

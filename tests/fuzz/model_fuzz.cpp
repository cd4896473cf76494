#include <array>
#include <memory>
#include <vector>

#include "firmware/nn/q_network.h"
#include "firmware/nn/test_model.h"
#include "tests/fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ivfm;
  static const auto network = std::make_unique<QNetwork>();
  std::vector<std::uint8_t> file(data, data + size);
  static_cast<void>(network->load(file));
  if (size < 16) return 0;
  TestModel::fix_checksum(file);
  if (!ok(network->load(file).status)) return 0;
  static std::vector<std::uint16_t> state(2 * 32 * 32);
  for (std::size_t i = 0; i < state.size(); ++i) state[i] = static_cast<std::uint16_t>(i * 40503u);
  static_cast<void>(network->run(state));
  return 0;
}

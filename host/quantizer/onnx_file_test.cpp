// OpenCV's DNN module, which shares nothing with our writer, reads the file and computes the same.
#include "host/quantizer/onnx_file.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/dnn.hpp>
#include <stdexcept>

#include "firmware/nn/state_encoder.h"
#include "host/quantizer/quantizer.h"

namespace ivfm::host {
namespace {

// The largest difference of OpenCV's values from ours, as a share of the spread of ours.
double worst_difference(const FloatNetwork& network, std::span<const std::uint16_t> states) {
  const std::string file = to_onnx(network);
  cv::dnn::Net reader = cv::dnn::readNetFromONNX(file.data(), file.size());
  FloatRunner runner(network);
  const std::size_t size = network.inputs.size() * kPolicyGridSize;
  double worst = 0;
  for (std::size_t at = 0; at < states.size(); at += size) {
    const auto state = states.subspan(at, size);
    const int shape[] = {1, static_cast<int>(network.inputs.size()), kPolicyCells, kPolicyCells};
    cv::Mat input(4, shape, CV_32F);
    std::copy(state.begin(), state.end(), input.ptr<float>());
    reader.setInput(input, "state");
    const cv::Mat output = reader.forward();
    const auto expected = runner.run(state);
    EXPECT_EQ(output.total(), expected.size());
    const auto [low, high] = std::ranges::minmax(expected);
    for (std::size_t i = 0; i < expected.size(); ++i) {
      const double difference = std::abs(double{output.ptr<float>()[i]} - double{expected[i]});
      worst = std::max(worst, difference / (double{high} - double{low}));
    }
  }
  return worst;
}

TEST(OnnxFile, OpenCvComputesTheShippedNetworksValues) {
  const FloatNetwork network =
      load_network(std::string(IVFM_SOURCE_DIR) + "/models/ivfm-unet18.fnet");
  EXPECT_LT(worst_difference(network, make_example_states(7, 20)), 1e-5);
}

class OnnxOfEveryState : public testing::TestWithParam<StateKind> {};

TEST_P(OnnxOfEveryState, OpenCvComputesOurValues) {
  const FloatNetwork network = make_random_network(3, GetParam());
  EXPECT_LT(worst_difference(network, make_example_states(5, 3, GetParam())), 1e-5);
}

INSTANTIATE_TEST_SUITE_P(States, OnnxOfEveryState,
                         testing::Values(StateKind::kIvfm, StateKind::kFoldedIvfm));

TEST(OnnxFile, RefusesWhatIsNoNetworkAndSaysWhatCannotBeWritten) {
  FloatNetwork network = make_unet18();
  EXPECT_THROW(save_onnx(network, "/no/such/folder/x.onnx"), std::runtime_error);
  network.layers.pop_back();
  EXPECT_THROW(to_onnx(network), std::invalid_argument);
}

}  // namespace
}  // namespace ivfm::host

#include "firmware/nn/model_view.h"

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <random>
#include <string>

#include "firmware/nn/q_network.h"
#include "firmware/nn/test_model.h"

namespace ivfm {
namespace {

ModelStatus load(const std::vector<std::uint8_t>& file) {
  ModelView model;
  return load_model(file, model);
}

TEST(LoadModel, ReadsEveryField) {
  TestModel test;
  test.inputs = {{20480, 9, 10}, {16640, -7, 11}};
  test.layers[0].bias[3] = -5;
  test.weight(0, 2, 4, 1) = 17;
  const std::vector<std::uint8_t> file = test.bytes();
  ModelView model;
  const ModelStatus status = load_model(file, model);
  ASSERT_EQ(status.status, Status::kOk) << status.reason;
  EXPECT_STREQ(model.name.data(), "test");
  EXPECT_EQ(model.state_kind, StateKind::kIvfm);
  EXPECT_EQ(model.policy_cell_um, 400'000u);
  EXPECT_EQ(model.inputs[1].offset, 16640);
  EXPECT_EQ(model.inputs[1].multiplier, -7);
  EXPECT_EQ(model.inputs[1].shift, 11);
  EXPECT_EQ(model.layer_count, 5);
  EXPECT_EQ(model.layers[0].stride, 2);
  EXPECT_TRUE(model.layers[0].relu);
  EXPECT_EQ(model.layers[0].bias[12], 0xfb);
  EXPECT_EQ(model.layers[0].weights[model_format::weight_index(2, 4, 1, 9, 4)], 17);
  EXPECT_EQ(model.layers[3].input_b, 3);
  EXPECT_TRUE(model.layers[4].raw);
  EXPECT_EQ(model.weight_bytes, 16u * 9 * 4 + 16 * 4 + 16 * 16);
  EXPECT_EQ(model.multiply_adds, 16 * 16 * 576 + 1024 * 64 + 1024 * 256);
  EXPECT_EQ(model.tensor_bytes, 81920u);
  EXPECT_TRUE(model.tensors[4].non_negative);
  EXPECT_GE(reinterpret_cast<const std::uint8_t*>(model.layers[0].weights), file.data());
}

TEST(LoadModel, RefusesEveryTruncation) {
  const std::vector<std::uint8_t> good = TestModel().bytes();
  for (std::size_t size = 0; size < good.size(); ++size) {
    std::vector<std::uint8_t> file(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_EQ(load(file).status, Status::kTruncated) << size;
    if (size < model_format::kHeaderBytes) continue;
    // The same with a size and a checksum that agree with the shorter file.
    for (std::size_t i = 0; i < 4; ++i) file[8 + i] = static_cast<std::uint8_t>(size >> (8 * i));
    TestModel::fix_checksum(file);
    EXPECT_FALSE(ok(load(file).status)) << size;
  }
}

TEST(LoadModel, RefusesTrailingBytes) {
  std::vector<std::uint8_t> file = TestModel().bytes();
  file.push_back(0);
  EXPECT_STREQ(load(file).reason, "bytes after the end of the model");
  file.resize(file.size() + 63);
  for (std::size_t i = 0; i < 4; ++i)
    file[8 + i] = static_cast<std::uint8_t>(file.size() >> (8 * i));
  TestModel::fix_checksum(file);
  EXPECT_STREQ(load(file).reason, "bytes that belong to no layer");
}

TEST(LoadModel, NoticesEveryFlippedBit) {
  std::vector<std::uint8_t> file = TestModel().bytes();
  for (std::size_t bit = 0; bit < file.size() * 8; bit += 7) {
    file[bit / 8] ^= static_cast<std::uint8_t>(1u << bit % 8);
    EXPECT_FALSE(ok(load(file).status)) << bit;
    file[bit / 8] ^= static_cast<std::uint8_t>(1u << bit % 8);
  }
}

// A byte of the file set to a value, the checksum made right, and the phrase that must answer it.
struct ByteFault {
  std::size_t at;
  int value;
  const char* reason;
};

TEST(LoadModel, NamesTheFaultOfEachHeaderField) {
  const ByteFault kFaults[] = {
      {0, 'X', "not a model file"},
      {4, 1, "a model file of another version; ivfm-train quantize writes this one"},
      {6, 64, "wrong header size"},
      {10, 8, "the model file is too large"},
      {16, 0, "no layers, or more than this build holds"},
      {16, 49, "no layers, or more than this build holds"},
      {17, 6, "the numbers of tensors and layers do not fit"},
      {18, 3, "unknown state kind"},
      {18, 1, "the input channels are not those of the state"},
      {19, 2, "unknown value kind"},
      {20, 3, "the input channels are not those of the state"},
      {21, 64, "not a 32 x 32 policy grid"},
      {22, 1, "reserved header bytes are not zero"},
      {26, 2, "the activations need too much memory"},
      {31, 0xbf, "bad output scale"},
      {39, 1, "reserved header bytes are not zero"},
      {41, 7, "the model's name is not printable ASCII"},
      {63, 'x', "the model's name does not end with zeros"},
      {66, 1, "an input channel's quantization is out of range"},
      {70, 1, "an input channel's quantization is out of range"},
      {72, 31, "an input channel's quantization is out of range"},
      {72, 0, "an input channel's quantization is out of range"},
      {73, 1, "an input channel's quantization is out of range"},
      {90, 1, "an unused input is not zero"},
      {120, 1, "reserved header bytes are not zero"},
  };
  for (const ByteFault& fault : kFaults) {
    std::vector<std::uint8_t> file = TestModel().bytes();
    file[fault.at] = static_cast<std::uint8_t>(fault.value);
    TestModel::fix_checksum(file);
    EXPECT_STREQ(load(file).reason, fault.reason) << fault.at;
  }
}

struct ModelFault {
  const char* reason;
  std::function<void(TestModel&)> spoil;
};

TEST(LoadModel, NamesTheFaultOfATensor) {
  const ModelFault kFaults[] = {
      {"a tensor's reserved byte is not zero", [](auto& m) { m.tensors[1].reserved = 1; }},
      {"a tensor's shape is out of range", [](auto& m) { m.tensors[1].height = 0; }},
      {"a tensor's shape is out of range", [](auto& m) { m.tensors[1].width = 33; }},
      {"a tensor's shape is out of range", [](auto& m) { m.tensors[1].channels = 144; }},
      {"a tensor's channels are no multiple of 16", [](auto& m) { m.tensors[1].channels = 8; }},
      {"a tensor lies outside the activation memory", [](auto& m) { m.tensors[3].offset = 49216; }},
      {"a tensor lies outside the activation memory",
       [](auto& m) { m.tensors[3].offset = 0xffffffc0; }},
      {"a tensor lies outside the activation memory", [](auto& m) { m.tensors[1].offset += 4; }},
      {"bad tensor scale", [](auto& m) { m.tensors[2].scale_bits = 0x7fc00000; }},
      {"the first tensor is not the state", [](auto& m) { m.tensors[0].height = 16; }},
      {"the first tensor is not the state", [](auto& m) { m.tensors[0].channels = 1; }},
  };
  for (const ModelFault& fault : kFaults) {
    TestModel model;
    fault.spoil(model);
    EXPECT_STREQ(load(model.bytes()).reason, fault.reason);
  }
}

TEST(LoadModel, NamesTheFaultOfALayer) {
  const ModelFault kFaults[] = {
      {"unknown layer kind", [](auto& m) { m.layers[0].kind = 4; }},
      {"unknown layer flag", [](auto& m) { m.layers[0].flags = 4; }},
      {"a layer's reserved byte is not zero", [](auto& m) { m.layers[0].reserved = 1; }},
      {"the head is not exactly the last layer", [](auto& m) { m.layers[0].flags = 2; }},
      {"the head is not exactly the last layer", [](auto& m) { m.layers[4].flags = 0; }},
      {"a layer reads a tensor that is not made yet", [](auto& m) { m.layers[1].input_a = 2; }},
      {"a layer reads a tensor that is not made yet", [](auto& m) { m.layers[3].input_b = 5; }},
      {"a layer without weights has a convolution's fields",
       [](auto& m) { m.layers[1].outputs = 16; }},
      {"a layer without weights has a convolution's fields",
       [](auto& m) { m.layers[3].stride = 2; }},
      {"an upsampling layer has fields of other layers", [](auto& m) { m.layers[1].shift = 1; }},
      {"an upsampling layer's shapes do not fit", [](auto& m) { m.tensors[2].height = 16; }},
      {"an addition has one operand only", [](auto& m) { m.layers[3].input_b = 0xff; }},
      {"an addition's shapes differ", [](auto& m) { m.layers[3].input_a = 1; }},
      {"an addition's scaling is out of range", [](auto& m) { m.layers[3].shift = 31; }},
      {"an addition's scaling is out of range",
       [](auto& m) { m.layers[3].multiplier_b = (1 << 15) + 1; }},
      {"a convolution has an addition's fields", [](auto& m) { m.layers[0].input_b = 0; }},
      {"a convolution has an addition's fields", [](auto& m) { m.layers[0].multiplier_a = 1; }},
      {"a convolution's stride is not supported", [](auto& m) { m.layers[0].stride = 3; }},
      {"a convolution's stride is not supported", [](auto& m) { m.layers[2].stride = 2; }},
      {"a convolution's scaling is out of range", [](auto& m) { m.layers[0].shift = 0; }},
      {"a convolution's scaling is out of range", [](auto& m) { m.layers[0].shift = 63; }},
      {"a convolution's scaling is out of range", [](auto& m) { m.layers[4].shift = 1; }},
      {"a convolution's shapes do not fit", [](auto& m) { m.layers[0].stride = 1; }},
      {"a convolution's shapes do not fit", [](auto& m) { m.tensors[1].channels = 32; }},
      {"the head does not answer one value a policy cell",
       [](auto& m) { m.layers[4].input_a = 1; }},
      {"the head does not answer one value a policy cell",
       [](auto& m) { m.layers[4].outputs = 2; }},
      {"a convolution's input may be negative",
       [](auto& m) {
         m.layers[2].flags = 0;
         m.layers[3].flags = 0;
       }},
      {"a layer's weights are not where they belong",
       [](auto& m) { m.layers[0].weights.resize(64); }},
      {"a weight of -128", [](auto& m) { m.weight(2, 3, 0, 1) = -128; }},
      {"a layer's sums can overflow", [](auto& m) { m.layers[0].bias[5] = INT32_MIN; }},
      {"a layer's sums can overflow",
       [](auto& m) {
         m.layers[2].bias[15] = INT32_MAX - kMaxActivation + 1;
         m.weight(2, 15, 0, 0) = -1;
       }},
      {"a layer's multiplier is out of range", [](auto& m) { m.layers[0].multipliers[7] = -1; }},
      {"a layer's multiplier is out of range", [](auto& m) { m.layers[4].multipliers[0] = 256; }},
      {"a layer overwrites a tensor in use", [](auto& m) { m.tensors[1].offset = 0; }},
      {"a layer overwrites a tensor in use", [](auto& m) { m.tensors[2].offset = 8192; }},
      {"a layer overwrites a tensor in use", [](auto& m) { m.tensors[3].offset = 16384; }},
      {"a layer overwrites a tensor in use",
       [](auto& m) { m.tensors[4].offset = m.tensors[3].offset - 64; }},
  };
  for (const ModelFault& fault : kFaults) {
    TestModel model;
    fault.spoil(model);
    EXPECT_STREQ(load(model.bytes()).reason, fault.reason);
  }
}

TEST(LoadModel, AcceptsSumsThatJustFit) {
  TestModel model;
  model.layers[2].bias[15] = INT32_MAX - kMaxActivation;
  model.weight(2, 15, 0, 0) = -1;
  EXPECT_STREQ(load(model.bytes()).reason, "");
}

TEST(LoadModel, RefusesRandomBytes) {
  std::mt19937 random(3);
  for (int i = 0; i < 300; ++i) {
    std::vector<std::uint8_t> file(random() % 3000);
    for (auto& b : file) b = static_cast<std::uint8_t>(random());
    EXPECT_FALSE(ok(load(file).status));
  }
}

// Whatever the loader accepts must run within its buffers (the sanitizers watch).
TEST(LoadModel, AcceptsOnlyWhatCanRun) {
  const std::vector<std::uint8_t> good = TestModel().bytes();
  const auto network = std::make_unique<QNetwork>();
  std::vector<std::uint16_t> state(2 * kPolicyGridSize);
  std::mt19937 random(4);
  for (auto& v : state) v = static_cast<std::uint16_t>(random());
  const std::size_t tables = 128 + 5 * 12 + 5 * 24;
  int accepted = 0;
  for (std::size_t at = 16; at < tables; ++at)
    for (const int value : {0, 1, 2, 3, 16, 32, 64, 127, 128, 255}) {
      std::vector<std::uint8_t> file = good;
      file[at] = static_cast<std::uint8_t>(value);
      TestModel::fix_checksum(file);
      if (!ok(network->load(file).status)) continue;
      ++accepted;
      const std::size_t channels = network->model().input_channels;
      EXPECT_EQ(network->run(std::span(state).first(channels * kPolicyGridSize)).size(), 1024u);
    }
  EXPECT_GT(accepted, 100);
}

TEST(LoadModel, SurvivesDamageInSeveralPlaces) {
  const std::vector<std::uint8_t> good = TestModel().bytes();
  const auto network = std::make_unique<QNetwork>();
  std::vector<std::uint16_t> state(2 * kPolicyGridSize, 30'000);
  std::mt19937 random(5);
  for (int i = 0; i < 3000; ++i) {
    std::vector<std::uint8_t> file = good;
    for (int k = 0; k < 3; ++k)
      file[16 + random() % (file.size() - 16)] = static_cast<std::uint8_t>(random());
    TestModel::fix_checksum(file);
    if (ok(network->load(file).status)) network->run(state);
  }
}

}  // namespace
}  // namespace ivfm

// Constants of the model file (MODEL_FORMAT.md), shared by the loader and by the tools that write
// it.
#pragma once

#include <cstddef>
#include <cstdint>

namespace ivfm {

enum class LayerKind : std::uint8_t {
  kConv3x3 = 0,     // zero padding of 1; stride 1 or 2
  kConv1x1 = 1,     // stride 1
  kUpsample2x = 2,  // nearest neighbour
  kAdd = 3,
};

// Which channels the network expects.
enum class StateKind : std::uint8_t {
  kIvfm = 0,        // i-VFM, path
  kVfm = 1,         // robot mask, occupancy, visits, path
  kFoldedIvfm = 2,  // one channel: the path folded into the i-VFM
};

// What a value of the head means.
enum class ValueKind : std::uint8_t {
  kDiscountedReturn = 0,  // expected discounted return of driving to that policy cell
  kScore = 1,             // a ranking score without a unit (imitation)
};

constexpr int channels_of(StateKind kind) {
  switch (kind) {
    case StateKind::kIvfm: return 2;
    case StateKind::kVfm: return 4;
    case StateKind::kFoldedIvfm: return 1;
  }
  return 0;
}

// Limits of one network, the same on every target.
inline constexpr std::size_t kMaxModelBytes = 448 * 1024;  // the file
inline constexpr std::size_t kMaxWeightBytes = 400'000;
inline constexpr std::size_t kTensorMemoryBytes = 80 * 1024;  // the activations
inline constexpr std::size_t kScratchBytes = 16 * 1024;       // the convolutions' padded rows
inline constexpr std::int64_t kMaxMultiplyAdds = 50'000'000;
inline constexpr int kMaxLayers = 48;
inline constexpr int kMaxTensors = kMaxLayers + 1;
inline constexpr int kMaxInputChannels = 4;
inline constexpr int kMaxChannels = 128;
inline constexpr int kMaxNameBytes = 24;
// Activations have 14 bits: 0 .. 16383 where the layer has ReLU, else -16383 .. 16383.
inline constexpr int kActivationBits = 14;
inline constexpr int kMaxActivation = (1 << kActivationBits) - 1;

namespace model_format {

inline constexpr std::uint32_t kMagic = 0x4e515649;  // "IVQN" in the file
inline constexpr std::uint16_t kVersion = 2;
inline constexpr std::size_t kHeaderBytes = 128;
inline constexpr std::size_t kTensorBytes = 12;
inline constexpr std::size_t kLayerBytes = 24;
inline constexpr std::size_t kInputChannelBytes = 12;
inline constexpr std::size_t kCrcFrom = 16;  // the checksum covers the bytes from here to the end
inline constexpr std::size_t kBlobAlignment = 64;
inline constexpr int kOutputGroup = 16;  // output channels are stored in groups of 16
inline constexpr int kInputGroup = 4;    // input channels in groups of 4 within them
inline constexpr std::uint8_t kNoTensor = 0xff;
inline constexpr std::uint32_t kMaxAddMultiplier = 1u << 15;
inline constexpr std::uint8_t kFlagRelu = 1;
inline constexpr std::uint8_t kFlagRaw = 2;  // the head: int32 accumulators, not requantized

// Where the weight of (output, ky, kx, input) lies: [out / 16][ky][kx][in / 4][out % 16][in % 4].
// `taps` is 9 or 1, `tap` ky * 3 + kx, `inputs` the input channels, a multiple of 4.
constexpr std::size_t weight_index(int output, int tap, int input, int taps, int inputs) {
  const int group = ((output / kOutputGroup * taps + tap) * inputs + input / kInputGroup * 4);
  return static_cast<std::size_t>(group * kOutputGroup + output % kOutputGroup * kInputGroup +
                                  input % kInputGroup);
}

}  // namespace model_format
}  // namespace ivfm

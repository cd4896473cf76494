#include "firmware/nn/kernels_tiled.h"

#include <algorithm>
#include <cstring>

#include "firmware/nn/little_endian.h"

namespace ivfm {
namespace {

// Three padded rows fit of every tensor that the loader takes. Grids are square: of 32 cells, with
// as many channels as the tensor memory holds, or of 16 at most, with all channels.
static_assert(kScratchBytes >= 3 * 34 * kTensorMemoryBytes / (32 * 32));
static_assert(kScratchBytes >= 3 * 18 * kMaxChannels * sizeof(std::int16_t));

// Some rows of a convolution's input, laid out in the scratch memory with their padding.
class Band {
 public:
  Band(const PatchLayout& layout, const LayerView& layer, const TensorView& in_shape,
       std::int16_t* scratch)
      : layout_(layout),
        shape_(in_shape),
        padding_(layer.side() / 2),
        memory_(reinterpret_cast<std::uint8_t*>(scratch)),
        pixel_bytes_(std::ptrdiff_t{in_shape.stored_channels()} * layout.value_bytes()),
        row_bytes_(pixel_bytes_ * (in_shape.width + 2 * padding_)),
        rows_(static_cast<int>(std::ptrdiff_t{kScratchBytes} / (row_bytes_ * layout.planes))) {}

  int rows() const { return rows_; }  // that fit
  std::ptrdiff_t pixel_bytes() const { return pixel_bytes_; }
  std::ptrdiff_t row_bytes() const { return row_bytes_; }
  std::ptrdiff_t plane_bytes() const { return row_bytes_ * rows_; }
  const std::uint8_t* row(int index) const { return memory_ + index * row_bytes_; }

  // Rows from `first` on; the padding begins at -1.
  void fill(const std::int16_t* in, int first, int count) {
    for (int i = 0; i < count; ++i) fill_row(in, first + i, memory_ + i * row_bytes_);
  }

 private:
  void fill_row(const std::int16_t* in, int y, std::uint8_t* out) {
    if (y < 0 || y >= shape_.height) return clear(out, row_bytes_);
    const auto values = static_cast<std::size_t>(shape_.width * shape_.stored_channels());
    const std::ptrdiff_t border = padding_ * pixel_bytes_;
    clear(out, border);
    layout_.store(in + static_cast<std::size_t>(y) * values, values, out + border, plane_bytes());
    clear(out + row_bytes_ - border, border);
  }

  void clear(std::uint8_t* out, std::ptrdiff_t bytes) const {
    for (int plane = 0; plane < layout_.planes; ++plane)
      std::memset(out + plane * plane_bytes(), 0, static_cast<std::size_t>(bytes));
  }

  const PatchLayout& layout_;
  const TensorView& shape_;
  int padding_;
  std::uint8_t* memory_;
  std::ptrdiff_t pixel_bytes_, row_bytes_;
  int rows_;
};

}  // namespace

void convolve_tiled(const PatchLayout& layout, const TileKernel* kernels, const LayerView& layer,
                    const TensorView& in_shape, const std::int16_t* in, std::int16_t* out,
                    std::int16_t* scratch) {
  Band band(layout, layer, in_shape, scratch);
  const int height = (in_shape.height + layer.stride - 1) / layer.stride;
  const int width = (in_shape.width + layer.stride - 1) / layer.stride;
  const int groups = layer.stored_outputs / model_format::kOutputGroup;
  while (width % kernels->pixels != 0 || groups % kernels->groups != 0) ++kernels;

  Tile tile{};
  tile.plane_bytes = band.plane_bytes();
  tile.pixel_bytes = layer.stride * band.pixel_bytes();
  tile.row_bytes = band.row_bytes();
  tile.rows = layer.side();
  tile.quads = tile.rows * in_shape.stored_channels() / 4;
  tile.group_bytes = std::ptrdiff_t{64} * tile.rows * tile.quads;
  tile.shift = layer.shift;
  tile.lowest = lowest_activation(layer);
  tile.output_values = layer.outputs;
  const int most_rows = (band.rows() - layer.side()) / layer.stride + 1;
  for (int top = 0; top < height; top += most_rows) {
    const int rows = std::min(most_rows, height - top);
    band.fill(in, top * layer.stride - layer.side() / 2, (rows - 1) * layer.stride + layer.side());
    for (int group = 0; group < groups; group += kernels->groups) {
      tile.weights = layer.weights + group * tile.group_bytes;
      tile.bias = layer.bias + std::ptrdiff_t{64} * group;
      tile.multipliers = layer.multipliers + std::ptrdiff_t{64} * group;
      for (int y = 0; y < rows; ++y)
        for (int x = 0; x < width; x += kernels->pixels) {
          tile.input = band.row(y * layer.stride) + x * tile.pixel_bytes;
          tile.output = out + ((top + y) * width + x) * tile.output_values + group * 16;
          kernels->run(tile);
        }
    }
  }
}

void head_fast(const LayerView& layer, const TensorView& in_shape, const std::int16_t* in,
               std::int32_t* out) {
  std::array<std::int16_t, kMaxChannels> weights{};
  const int channels = in_shape.stored_channels();
  for (int c = 0; c < channels; ++c)
    weights[static_cast<std::size_t>(c)] =
        layer.weights[model_format::weight_index(0, 0, c, 1, channels)];
  const std::int32_t bias = read_i32(layer.bias);
  for (int i = 0; i < in_shape.height * in_shape.width; ++i, in += channels) {
    std::int32_t sum = bias;
    for (int c = 0; c < channels; ++c) sum += weights[static_cast<std::size_t>(c)] * in[c];
    out[i] = sum;
  }
}

}  // namespace ivfm

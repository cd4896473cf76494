// A robot's map for tests of the link and the server: a window with its own cells and the others'.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "firmware/link/shared_map.h"

namespace ivfm::fake {

template <typename Visit>
void for_each_cell(const CellRect& rect, Visit visit) {
  for (std::int32_t y = rect.y; y < rect.top(); ++y) {
    for (std::int32_t x = rect.x; x < rect.right(); ++x) visit(Cell{x, y});
  }
}

class SmallMap final : public SharedMap {
 public:
  explicit SmallMap(const CellRect& window) : frame_(50000, window) {
    for (auto* layers : {&own_, &peers_, &seen_}) {
      for (auto& layer : *layers) layer.resize(frame_.size());
    }
  }
  Status read_own(Layer layer, const CellRect& rect, std::span<std::uint8_t> out) const override {
    if (!frame_.window().contains(rect)) return Status::kOutOfRange;
    std::size_t i = 0;
    for_each_cell(rect, [&](Cell c) { out[i++] = own(layer, c); });
    return Status::kOk;
  }
  Status write_peers(Layer layer, const CellRect& rect,
                     std::span<const std::uint8_t> cells) override {
    std::size_t i = 0;
    for_each_cell(rect, [&](Cell c) {
      if (frame_.contains(c)) peers_[at(layer)][frame_.index_of(c)] = cells[i];
      ++i;
    });
    return Status::kOk;
  }
  Status restore_own(Layer layer, const CellRect& rect,
                     std::span<const std::uint8_t> cells) override {
    std::size_t i = 0;
    for_each_cell(rect, [&](Cell c) {
      const std::uint8_t before = cells[i++];
      if (!frame_.contains(c)) return;
      const bool seen = seen_[at(layer)][frame_.index_of(c)] != 0;
      std::uint8_t& value = own_[at(layer)][frame_.index_of(c)];
      if (layer == Layer::kVisits) {
        value = static_cast<std::uint8_t>(std::min(255, value + before));
      } else if (!seen) {
        value = before;
      }
      if (value != before) changes_[at(layer)] = changes_[at(layer)].united(c);
    });
    return Status::kOk;
  }
  // What is not as restore_own() said, since the last call.
  CellRect take_changes(Layer layer) { return std::exchange(changes_[at(layer)], {}); }

  const CellRect& window() const { return frame_.window(); }
  std::uint8_t own(Layer layer, Cell c) const { return own_[at(layer)][frame_.index_of(c)]; }
  void set_own(Layer layer, Cell c, std::uint8_t value) {
    own_[at(layer)][frame_.index_of(c)] = value;
    seen_[at(layer)][frame_.index_of(c)] = 1;
  }
  // One visit more in each cell.
  void visit(const CellRect& rect) {
    for_each_cell(rect, [&](Cell c) {
      const std::uint8_t visits = own(Layer::kVisits, c);
      set_own(Layer::kVisits, c, static_cast<std::uint8_t>(std::min(255, visits + 1)));
    });
  }
  std::uint8_t peers(Layer layer, Cell c) const { return peers_[at(layer)][frame_.index_of(c)]; }

 private:
  static std::size_t at(Layer layer) { return static_cast<std::size_t>(layer); }
  GridFrame frame_;
  std::array<std::vector<std::uint8_t>, kLayerCount> own_, peers_, seen_;  // seen: since the start
  std::array<CellRect, kLayerCount> changes_{};
};

}  // namespace ivfm::fake

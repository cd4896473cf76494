#include "host/trainer/label_buffer.h"

#include <istream>
#include <iterator>
#include <ostream>
#include <stdexcept>
#include <type_traits>
#include <utility>

namespace ivfm::host {
namespace {

constexpr std::uint64_t kMagic = 0x31534C4542414C49ull;  // "ILABELS1"

template <typename T>
void write_items(std::ostream& out, const T* items, std::size_t count) {
  static_assert(std::is_trivially_copyable_v<T>);
  out.write(reinterpret_cast<const char*>(items), static_cast<std::streamsize>(count * sizeof(T)));
}

template <typename T>
void read_items(std::istream& in, T* items, std::size_t count) {
  static_assert(std::is_trivially_copyable_v<T>);
  in.read(reinterpret_cast<char*>(items), static_cast<std::streamsize>(count * sizeof(T)));
  if (!in) throw std::runtime_error("labels: the file ends too early");
}

}  // namespace

void LabelBuffer::add(LabelledState state) {
  if (states_.size() < capacity_) {
    states_.push_back(std::move(state));
    return;
  }
  states_[next_] = std::move(state);
  next_ = (next_ + 1) % capacity_;
}

void LabelBuffer::clear() {
  states_.clear();
  next_ = 0;
}

void LabelBuffer::save(std::ostream& out) const {
  const std::uint64_t header[] = {kMagic, capacity_, states_.size(), next_};
  write_items(out, header, std::size(header));
  for (const LabelledState& state : states_) {
    const std::uint64_t count = state.actions.size();
    write_items(out, &state.observation, 1);
    write_items(out, &count, 1);
    write_items(out, state.actions.data(), state.actions.size());
    write_items(out, state.values.data(), state.values.size());
  }
}

void LabelBuffer::load(std::istream& in) {
  std::uint64_t header[4];
  read_items(in, header, std::size(header));
  if (header[0] != kMagic || header[1] != capacity_ || header[2] > capacity_ ||
      header[3] >= capacity_)
    throw std::runtime_error("labels: not a file of this configuration");
  states_.assign(header[2], {});
  next_ = header[3];
  for (LabelledState& state : states_) {
    std::uint64_t count = 0;
    read_items(in, &state.observation, 1);
    read_items(in, &count, 1);
    if (count > kActions) throw std::runtime_error("labels: the file is damaged");
    state.actions.resize(count);
    state.values.resize(count);
    read_items(in, state.actions.data(), state.actions.size());
    read_items(in, state.values.data(), state.values.size());
  }
}

}  // namespace ivfm::host

#include "host/trainer/replay_buffer.h"

#include <algorithm>
#include <istream>
#include <ostream>
#include <stdexcept>
#include <type_traits>

namespace ivfm::host {
namespace {

constexpr std::uint64_t kMagic = 0x3159414C50455249ull;  // "IREPLAY1"

template <typename T>
void write_items(std::ostream& out, const T* items, std::size_t count) {
  static_assert(std::is_trivially_copyable_v<T>);
  out.write(reinterpret_cast<const char*>(items), static_cast<std::streamsize>(count * sizeof(T)));
}

template <typename T>
void read_items(std::istream& in, T* items, std::size_t count) {
  static_assert(std::is_trivially_copyable_v<T>);
  in.read(reinterpret_cast<char*>(items), static_cast<std::streamsize>(count * sizeof(T)));
  if (!in) throw std::runtime_error("replay: the file ends too early");
}

}  // namespace

ReplayBuffer::ReplayBuffer(std::size_t observations, std::size_t transitions)
    : observations_(observations), transitions_(transitions) {}

ObservationId ReplayBuffer::add(const Observation& observation) {
  observations_[static_cast<std::size_t>(next_id_) % observations_.size()] = observation;
  return next_id_++;
}

void ReplayBuffer::add(const Transition& transition) {
  transitions_[next_transition_] = transition;
  next_transition_ = (next_transition_ + 1) % transitions_.size();
  transitions_held_ = std::min(transitions_held_ + 1, transitions_.size());
}

const Transition& ReplayBuffer::sample(ResumableRandom& random) const {
  while (true) {
    const Transition& t = transitions_[random.below(transitions_held_)];
    if (holds(t.from) && (t.to == kNoObservation || holds(t.to))) return t;
  }
}

std::vector<Transition> ReplayBuffer::sample_siblings(std::size_t most,
                                                      ResumableRandom& random) const {
  const Transition& first = sample(random);
  auto low = static_cast<std::size_t>(&first - transitions_.data()), high = low + 1;
  const auto is_sibling = [&](const Transition& t) {
    return t.from == first.from && (t.to == kNoObservation || holds(t.to));
  };
  while (low > 0 && is_sibling(transitions_[low - 1])) --low;
  while (high < transitions_held_ && is_sibling(transitions_[high])) ++high;
  const std::size_t count = std::min(most, high - low);
  const std::size_t begin = low + random.below(high - low - count + 1);
  const auto from = transitions_.begin() + static_cast<std::ptrdiff_t>(begin);
  return {from, from + static_cast<std::ptrdiff_t>(count)};
}

ObservationId ReplayBuffer::sample_observation(ResumableRandom& random) const {
  const auto capacity = static_cast<ObservationId>(observations_.size());
  const ObservationId held = std::min(next_id_, capacity);
  return next_id_ - 1 - static_cast<ObservationId>(random.below(static_cast<std::uint64_t>(held)));
}

void ReplayBuffer::save(std::ostream& out) const {
  const std::uint64_t header[] = {kMagic,
                                  observations_.size(),
                                  transitions_.size(),
                                  static_cast<std::uint64_t>(next_id_),
                                  transitions_held_,
                                  next_transition_};
  write_items(out, header, std::size(header));
  const auto held = std::min(observations_.size(), static_cast<std::size_t>(next_id_));
  write_items(out, observations_.data(), held);
  write_items(out, transitions_.data(), transitions_held_);
}

void ReplayBuffer::load(std::istream& in) {
  std::uint64_t header[6];
  read_items(in, header, std::size(header));
  if (header[0] != kMagic || header[1] != observations_.size() ||
      header[2] != transitions_.size() || header[4] > header[2] || header[5] >= header[2])
    throw std::runtime_error("replay: not a replay file of this configuration");
  next_id_ = static_cast<ObservationId>(header[3]);
  transitions_held_ = header[4];
  next_transition_ = header[5];
  const auto held = std::min(observations_.size(), static_cast<std::size_t>(next_id_));
  read_items(in, observations_.data(), held);
  read_items(in, transitions_.data(), transitions_held_);
}

}  // namespace ivfm::host

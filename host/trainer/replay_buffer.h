// The trainer's memory: a ring of observations and of the transitions between them.
#pragma once

#include <cstdint>
#include <iosfwd>
#include <vector>

#include "host/trainer/observation.h"
#include "host/trainer/resumable_random.h"

namespace ivfm::host {

// An observation's number since the start of training; numbers are never reused.
using ObservationId = std::int64_t;
inline constexpr ObservationId kNoObservation = -1;

// `reward` was earned from `from` by `action` and what followed, until `to`; its value counts
// `discount` times. `to` is kNoObservation when the episode ended.
struct Transition {
  ObservationId from = kNoObservation;
  ObservationId to = kNoObservation;
  std::int32_t action = 0;
  float reward = 0;
  float discount = 0;
};

class ReplayBuffer {
 public:
  // Keeps the newest `observations` and the newest `transitions` (both > 0).
  ReplayBuffer(std::size_t observations, std::size_t transitions);

  ObservationId add(const Observation& observation);
  // Requires both ends to be held.
  void add(const Transition& transition);

  std::size_t transitions() const { return transitions_held_; }
  bool holds(ObservationId id) const {
    return id >= 0 && id < next_id_ &&
           id >= next_id_ - static_cast<ObservationId>(observations_.size());
  }
  // Requires holds(id).
  const Observation& observation(ObservationId id) const {
    return observations_[static_cast<std::size_t>(id) % observations_.size()];
  }
  // A transition whose ends are still held, uniformly. Requires one (transitions() > 0 and the
  // newest transition's ends held).
  const Transition& sample(ResumableRandom& random) const;
  // A sampled transition with the up to `most` - 1 others that were added beside it and start from
  // the same observation (most >= 1): what was tried there. Requirements as sample().
  std::vector<Transition> sample_siblings(std::size_t most, ResumableRandom& random) const;
  // Any held observation, uniformly. Requires at least one add().
  ObservationId sample_observation(ResumableRandom& random) const;

  // Everything the buffer holds, as bytes (host byte order). load() throws std::runtime_error
  // when the bytes are not a buffer of the same capacity.
  void save(std::ostream& out) const;
  void load(std::istream& in);

 private:
  std::vector<Observation> observations_;
  std::vector<Transition> transitions_;
  ObservationId next_id_ = 0;
  std::size_t transitions_held_ = 0;
  std::size_t next_transition_ = 0;
};

}  // namespace ivfm::host

// The trainer's memory: a ring of states whose goals were tried, with what each of them was worth.
#pragma once

#include <cstddef>
#include <iosfwd>
#include <vector>

#include "host/trainer/learner_config.h"

namespace ivfm::host {

class LabelBuffer {
 public:
  // Keeps the newest `capacity` (> 0) states.
  explicit LabelBuffer(std::size_t capacity) : capacity_(capacity) {}

  void add(LabelledState state);
  void clear();
  std::size_t size() const { return states_.size(); }
  const LabelledState& operator[](std::size_t i) const { return states_[i]; }

  // Everything, so that a resumed run draws the same samples. load() throws std::runtime_error for
  // a file that is damaged or of another capacity.
  void save(std::ostream& out) const;
  void load(std::istream& in);

 private:
  std::size_t capacity_;
  std::size_t next_ = 0;  // replaced next, once the ring is full
  std::vector<LabelledState> states_;
};

}  // namespace ivfm::host

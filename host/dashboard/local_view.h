// What a robot's policy sees around it and what it thinks of it: the i-VFM, the way to each place
// and the Q map, computed from the fleet's map by the robot's own code.
#pragma once

#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "host/dashboard/live_state.h"

namespace ivfm::host {

class LocalView {
 public:
  // `model`: of the robots; empty: no Q map. `visit_range_m`: of the robots, decides the size of
  // the local map. Throws std::runtime_error when the model cannot be used.
  LocalView(const std::filesystem::path& model, double visit_range_m);
  ~LocalView();
  LocalView(const LocalView&) = delete;
  LocalView& operator=(const LocalView&) = delete;

  // JSON (docs/page.md), `null` while the robot's place is not known. From any thread.
  std::string describe(const LiveState& state, std::uint16_t robot);

 private:
  struct Policy;
  std::mutex mutex_;
  std::unique_ptr<Policy> policy_;
};

}  // namespace ivfm::host

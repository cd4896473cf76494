// What an episode's robots send and receive: counted on their real links and the real map server.
#pragma once

#include <cstdint>
#include <memory>

#include "host/environment/exploration_environment.h"

namespace ivfm::host {

// Each agent has the firmware's link with an encrypting seal, on a radio that loses nothing, to a
// map server in memory. Counted are all datagrams both ways with their IP and UDP headers: hellos,
// map updates, status every second, places of the others, acknowledgements. The agents drive at the
// same time here, so that an action lasts its own time divided by their number. The same episode
// gives the same bytes.
class WireMeter {
 public:
  // Listens to what `env` shares from now on, until destroyed; make it before reset(). `env` must
  // outlive it.
  explicit WireMeter(ExplorationEnvironment& env);
  ~WireMeter();
  WireMeter(const WireMeter&) = delete;
  WireMeter& operator=(const WireMeter&) = delete;

  // After each action, which took `sim_steps` (1/240 s): sends what it changed.
  void note_action(std::int32_t sim_steps);
  // The bytes of the episode; lets what is on its way arrive first, ten seconds at most.
  std::uint64_t finish();

 private:
  struct Team;
  ExplorationEnvironment& env_;
  std::unique_ptr<Team> team_;
};

}  // namespace ivfm::host

// The seals of the robots whose keys a file holds.
#pragma once

#include <map>
#include <string>

#include "firmware/hal/linux/radio_key_file.h"
#include "host/map_server/map_server.h"

namespace ivfm::host {

class KeyRing final : public RobotSeals {
 public:
  explicit KeyRing(const RadioKeys& keys) : seals_(keys.begin(), keys.end()) {}
  const DatagramSeal* of(std::uint16_t robot) const override {
    const auto seal = seals_.find(robot);
    return seal == seals_.end() ? nullptr : &seal->second;
  }
  std::size_t size() const { return seals_.size(); }

 private:
  std::map<std::uint16_t, SodiumSeal> seals_;
};

}  // namespace ivfm::host

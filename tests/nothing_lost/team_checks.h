// What must hold of a team's maps and the server's, however they were treated.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tests/nothing_lost/team_robot.h"

namespace ivfm::host {

// The server's value of a cell, of one robot, or of all together (robot 0).
using ServerValue = std::function<unsigned(std::uint16_t robot, Layer layer, Cell cell)>;

// Both answer a sentence on the first thing that is wrong, empty when all is well, and add to
// `cells` how many they looked at.

// Whatever a robot was told to be safe, the server has.
std::string find_missing_cell(const std::vector<TeamRobot*>& robots, const ServerValue& server,
                              std::uint64_t& cells);
// The server has each robot's map and their sum, and each robot has the sum of the others'.
std::string find_different_cell(const std::vector<TeamRobot*>& robots, const ServerValue& server,
                                std::uint64_t& cells);

}  // namespace ivfm::host

#include "tests/nothing_lost/team_checks.h"

#include <sstream>

namespace ivfm::host {
namespace {

// Looks at cells one by one and keeps the first complaint.
class Inspection {
 public:
  explicit Inspection(std::uint64_t& cells) : cells_(cells) {}
  void expect(bool good, Layer layer, Cell c, unsigned got, unsigned wanted, const char* what,
              std::uint16_t robot) {
    ++cells_;
    if (good || !complaint_.empty()) return;
    std::ostringstream text;
    text << (layer == Layer::kVisits ? "visits" : "obstacles") << " of cell (" << c.x << ", " << c.y
         << "), " << what << " robot " << robot << ": " << got << " instead of " << wanted;
    complaint_ = text.str();
  }
  const std::string& complaint() const { return complaint_; }

 private:
  std::uint64_t& cells_;
  std::string complaint_;
};

}  // namespace

std::string find_missing_cell(const std::vector<TeamRobot*>& robots, const ServerValue& server,
                              std::uint64_t& cells) {
  Inspection inspection(cells);
  for (TeamRobot* const robot : robots) {
    const fake::SmallMap& acknowledged = robot->acknowledged_visits();
    fake::for_each_cell(TeamRobot::kWindow, [&](Cell c) {
      const unsigned visits = acknowledged.own(Layer::kVisits, c);
      if (visits != 0) {
        const unsigned got = server(robot->id(), Layer::kVisits, c);
        inspection.expect(got >= visits, Layer::kVisits, c, got, visits, "acknowledged to",
                          robot->id());
      }
      // An obstacle may come and go: only what is acknowledged and has not changed since must hold.
      if (robot->runs() && robot->is_acknowledged(Layer::kObstacles, c)) {
        const unsigned got = server(robot->id(), Layer::kObstacles, c);
        const unsigned own = robot->map().own(Layer::kObstacles, c);
        inspection.expect(got == own, Layer::kObstacles, c, got, own, "acknowledged to",
                          robot->id());
      }
    });
  }
  return inspection.complaint();
}

std::string find_different_cell(const std::vector<TeamRobot*>& robots, const ServerValue& server,
                                std::uint64_t& cells) {
  Inspection inspection(cells);
  for (const Layer layer : kLayers) {
    const unsigned most = layer == Layer::kVisits ? 255 : 1;
    fake::for_each_cell(TeamRobot::kWindow, [&](Cell c) {
      const auto expect = [&](unsigned got, unsigned wanted, const char* what,
                              std::uint16_t robot) {
        inspection.expect(got == wanted, layer, c, got, wanted, what, robot);
      };
      unsigned sum = 0;
      for (const TeamRobot* robot : robots) {
        const unsigned own = robot->map().own(layer, c);
        sum += own;
        expect(server(robot->id(), layer, c), own, "what the server has of", robot->id());
      }
      expect(server(0, layer, c), std::min(most, sum), "what the server has of all,", 0);
      for (const TeamRobot* robot : robots) {
        const unsigned others = sum - robot->map().own(layer, c);
        expect(robot->map().peers(layer, c), std::min(most, others), "the others' at", robot->id());
      }
    });
  }
  return inspection.complaint();
}

}  // namespace ivfm::host

#include "host/dashboard/local_view.h"

#include <nlohmann/json.hpp>
#include <optional>

#include "firmware/agent/profile.h"
#include "firmware/planning/explorer.h"
#include "host/quantizer/robot_model.h"

namespace ivfm::host {
namespace {

using nlohmann::json;

constexpr double kIvfmUnits = 4096;  // Q12
constexpr double kPathUnits = 256;

}  // namespace

struct LocalView::Policy {
  std::optional<RobotModel> model;
  double visit_range_m = 3;
  std::unique_ptr<ExplorerFor<RobotProfile>> explorer;

  // The explorer for cells of this size, which forgets what it knew.
  Explorer& start(const Neighbourhood& place) {
    if (!explorer || explorer->map().frame().cell_um() != place.map.cell_um) {
      const ExplorerConfig config =
          ExplorerConfig::lidar(static_cast<std::int32_t>(visit_range_m * 1e6), place.map.cell_um);
      explorer = std::make_unique<ExplorerFor<RobotProfile>>(config, place.map.cell_um);
    }
    explorer->start(place.pose);
    ExplorationMap& map = explorer->map();
    (void)map.write_peers(Layer::kVisits, place.map.bounds, place.map.visits);
    (void)map.write_peers(Layer::kObstacles, place.map.bounds, place.map.obstacles);
    explorer->observe(place.pose);
    return *explorer;
  }
};

LocalView::LocalView(const std::filesystem::path& model, double visit_range_m)
    : policy_(std::make_unique<Policy>()) {
  policy_->visit_range_m = visit_range_m;
  if (!model.empty()) policy_->model.emplace(model);
}

LocalView::~LocalView() = default;

std::string LocalView::describe(const LiveState& state, std::uint16_t robot) {
  const std::lock_guard lock(mutex_);
  const auto place = state.neighbourhood(robot, kPolicyCells * kMaxPool / 2);
  if (!place) return "null";
  Explorer& explorer = policy_->start(*place);
  const LocalState& seen = explorer.state();
  const double cell_m = place->map.cell_um / 1e6;
  json out{{"robot", robot},
           {"side", kPolicyCells},
           {"cell_m", cell_m * seen.grid.pool},
           {"origin", {seen.grid.origin.x * cell_m, seen.grid.origin.y * cell_m}},
           {"ivfm", json::array()},
           {"path", json::array()},
           {"q", nullptr},
           {"best", nullptr}};
  for (const std::uint16_t value : seen.ivfm()) out["ivfm"].push_back(value / kIvfmUnits);
  for (const std::uint16_t value : seen.path()) {
    const bool reachable = value != kPathUnreachable;
    out["path"].push_back(reachable ? json(value / kPathUnits * cell_m * seen.grid.pool)
                                    : json(nullptr));
  }
  std::array<std::int32_t, kPolicyGridSize> q;
  if (!policy_->model || !ok(policy_->model->network().evaluate(seen, q))) return out.dump();
  out["q"] = json::array();
  std::optional<std::size_t> best;
  for (std::size_t i = 0; i < q.size(); ++i) {
    const bool possible = explorer.goal_mask()[i] != 0;
    out["q"].push_back(possible ? json(q[i]) : json(nullptr));
    if (possible && (!best || q[i] > q[*best])) best = i;
  }
  if (best) out["best"] = *best;
  return out.dump();
}

}  // namespace ivfm::host

#include "tests/replay/replay_player.h"

namespace ivfm::replay {

namespace {

void add_rect(Fnv1a& hash, const CellRect& rect) {
  for (const std::int32_t side : {rect.x, rect.y, rect.width, rect.height}) hash.add(side);
}

void add_map(Fnv1a& hash, const ExplorationMap& map) {
  const CellRect known = map.known_rect().intersection(map.frame().window());
  const MapLayers& layers = map.layers();
  add_rect(hash, map.frame().window());
  add_rect(hash, known);
  for (std::int32_t y = known.y; y < known.top(); ++y) {
    for (std::int32_t x = known.x; x < known.right(); ++x) {
      const std::size_t index = map.frame().index_of({x, y});
      hash.add(layers.occupancy[index]);
      hash.add(layers.own_visits[index]);
      hash.add(layers.peer_visits[index]);
      hash.add(layers.flags[index]);
      hash.add(layers.inflation[index]);
    }
  }
}

void count(ReplaySummary& summary, const Decision& decision) {
  ++summary.decisions;
  summary.local_goals += decision.kind == Decision::Kind::kLocalGoal ? 1 : 0;
}

}  // namespace

std::uint64_t hash_decision(const Explorer& explorer, const Decision& decision) {
  Fnv1a hash;
  add_map(hash, explorer.map());
  for (const std::uint16_t value : explorer.state().channels) hash.add(value);
  for (const std::int32_t value : explorer.q_values()) hash.add(value);
  hash.add(static_cast<std::uint8_t>(decision.kind));
  hash.add(decision.goal.x);
  hash.add(decision.goal.y);
  hash.add(decision.policy_cell);
  hash.add(decision.q_value);
  for (const Point& point : explorer.path().points()) {
    hash.add(point.x_um);
    hash.add(point.y_um);
  }
  return hash.value();
}

Status AgentReplay::run(Agent& agent, DecisionListener* listener, ReplaySummary& summary) {
  while (!reader_.at_end()) {
    input_.read(reader_);
    if (!ok(reader_.status())) break;
    step(agent, listener, summary);
  }
  summary.matched = agent.localization().counters().matched;
  summary.frames_sent = can_.sent();
  summary.hash = hash_.value();
  return reader_.status();
}

// A decision shows as a new action or as the state that "nothing left to explore" leads to.
void AgentReplay::step(Agent& agent, DecisionListener* listener, ReplaySummary& summary) {
  const AgentProgress before = agent.progress();
  const std::uint64_t work = counter_ != nullptr ? counter_->now() : 0;
  agent.step(input_.now_us);
  const std::uint64_t spent = counter_ != nullptr ? counter_->now() - work : 0;
  ++summary.steps;
  summary.unused_steps += input_.is_used_up() ? 0 : 1;
  const bool fused = agent.progress().scans_fused != before.scans_fused;
  const bool explored = agent.state() != state_ && agent.state() == RobotState::kExplored;
  state_ = agent.state();
  summary.scans += fused ? 1 : 0;
  hash_.add(static_cast<std::uint8_t>(state_));
  hash_.add(agent.pose().position.x_um);
  hash_.add(agent.pose().position.y_um);
  hash_.add(agent.pose().heading.raw());
  const bool decided = agent.progress().actions != before.actions || explored;
  revolution_ += spent;
  decided_ = decided_ || decided;
  if (fused) {
    if (!decided_) summary.revolution_work.add(revolution_);
    revolution_ = 0;
    decided_ = false;
  }
  if (!decided) {
    (fused ? summary.scan_work : summary.step_work).add(spent);
    if (fused) summary.fusion_work.add(clock_.last_work());
    return;
  }
  count(summary, agent.decision());
  summary.decision_work.add(clock_.last_work());
  const std::uint64_t hash = hash_decision(agent.explorer(), agent.decision());
  hash_.add(hash);
  if (listener == nullptr) return;
  listener->on_decision(
      {summary.decisions, input_.now_us, agent.decision(), hash, clock_.last_work()});
}

namespace {

Pose read_pose(ReplayReader& reader) {
  Pose pose;
  pose.position.x_um = static_cast<std::int32_t>(reader.signed_varint());
  pose.position.y_um = static_cast<std::int32_t>(reader.signed_varint());
  pose.heading = BinaryAngle(static_cast<std::uint16_t>(reader.varint()));
  return pose;
}

void read_scan(ReplayReader& reader, Scan& scan) {
  scan.clear();
  const std::uint64_t size = reader.varint();
  if (size > Scan::kMaxPoints) return reader.fail(Status::kCorrupt);
  std::int64_t bearing = 0, range = 0;
  for (std::uint64_t i = 0; i < size; ++i) {
    bearing += reader.signed_varint() % 0x10000;
    const std::uint64_t tagged = reader.varint();
    if ((tagged & 3) > 2) return reader.fail(Status::kCorrupt);
    const std::uint64_t folded = tagged >> 2;
    range += static_cast<std::int64_t>((folded >> 1) ^ (0 - (folded & 1))) % 0x10000;
    scan.push({BinaryAngle(static_cast<std::uint16_t>(bearing)), static_cast<std::uint16_t>(range),
               static_cast<Echo>(tagged & 3), 0});
  }
}

}  // namespace

Status replay_explorer(ReplayReader& reader, Explorer& explorer, QFunction& policy,
                       DecisionListener* listener, ReplaySummary& summary) {
  Fnv1a hash;
  Scan scan;
  while (!reader.at_end()) {
    switch (static_cast<Call>(reader.u8())) {
      case Call::kStart: {
        const Pose pose = read_pose(reader);
        const Pose center = read_pose(reader);
        if (ok(reader.status())) explorer.start(pose, center.position);
        break;
      }
      case Call::kBeginAction: explorer.begin_action(); break;
      case Call::kAbandonGoal: explorer.abandon_goal(); break;
      case Call::kFuse: {
        const Pose pose = read_pose(reader);
        const bool count_visits = reader.u8() != 0;
        read_scan(reader, scan);
        if (!ok(reader.status())) break;
        explorer.fuse(pose, scan, count_visits);
        ++summary.steps;
        ++summary.scans;
        break;
      }
      case Call::kDecide: {
        const Pose pose = read_pose(reader);
        if (!ok(reader.status())) break;
        const Decision decision = explorer.decide(pose, policy);
        count(summary, decision);
        const std::uint64_t decision_hash = hash_decision(explorer, decision);
        hash.add(decision_hash);
        if (listener) listener->on_decision({summary.decisions, 0, decision, decision_hash, 0});
        break;
      }
      default: reader.fail(Status::kCorrupt);
    }
  }
  summary.hash = hash.value();
  return reader.status();
}

}  // namespace ivfm::replay

#include "host/trainer/trainer_config.h"

#include <toml++/toml.h>

#include <set>
#include <sstream>
#include <stdexcept>

#include "host/environment/network_state.h"

namespace ivfm::host {
namespace {

std::string place(const std::string& path, const toml::node& node) {
  return path + ":" + std::to_string(node.source().begin.line) + ": ";
}

template <typename T>
constexpr const char* type_name() {
  if constexpr (std::is_same_v<T, bool>) return "true or false";
  if constexpr (std::is_same_v<T, std::string>) return "a string";
  if constexpr (std::is_floating_point_v<T>) return "a number";
  return "a whole number";
}

template <typename T>
void assign(const std::string& path, const std::string& name, const toml::node& node, T& value) {
  const auto read = node.value<T>();
  if (!read) throw std::runtime_error(place(path, node) + name + " must be " + type_name<T>());
  value = *read;
}

void require(bool condition, const char* message) {
  if (!condition) throw std::invalid_argument(message);
}

}  // namespace

void load_config(const std::string& path, TrainerConfig& config) {
  toml::table file;
  try {
    file = toml::parse_file(path);
  } catch (const toml::parse_error& e) {
    throw std::runtime_error(path + ":" + std::to_string(e.source().begin.line) + ": " +
                             std::string(e.description()));
  }
  std::set<std::string> known;
  visit_options(config, [&](const char* name, auto& value, const char*) {
    known.insert(name);
    if (const auto node = file.at_path(name)) assign(path, name, *node.node(), value);
  });
  for (const auto& [table_name, table] : file) {
    if (!table.is_table())
      throw std::runtime_error(place(path, table) + "options stand in tables such as [run]");
    for (const auto& [key, node] : *table.as_table()) {
      const std::string name = std::string(table_name.str()) + "." + std::string(key.str());
      if (!known.contains(name)) throw std::runtime_error(place(path, node) + "no option " + name);
    }
  }
}

std::string to_toml(const TrainerConfig& config) {
  toml::table file;
  visit_options(config, [&](const std::string& name, const auto& value, const char*) {
    using T = std::decay_t<decltype(value)>;
    const std::string table = name.substr(0, name.find('.')), key = name.substr(table.size() + 1);
    toml::table& entries = *file.insert(table, toml::table{}).first->second.as_table();
    if constexpr (std::is_integral_v<T> && !std::is_same_v<T, bool>)
      entries.insert(key, static_cast<std::int64_t>(value));
    else
      entries.insert(key, value);
  });
  std::ostringstream out;
  out << file << '\n';
  return out.str();
}

void check(const TrainerConfig& c) {
  const auto is_share = [](double v) { return v > 0 && v <= 1; };
  require(c.steps >= 0 && c.one_move_steps >= 0 && c.quantized_steps >= 0,
          "run.steps, run.one_move_steps and run.quantized_steps: 0 or more");
  require(state_kind_from_name(c.state).has_value(), "run.state: ivfm, vfm or folded");
  require(c.state == "ivfm" || c.quantized_steps == 0,
          "run.quantized_steps: only the ivfm state runs on board; 0 for others");
  require(c.threads >= 1, "run.threads: 1 or more");
  require(c.environments >= 1 && c.labels >= 1, "collect.environments, collect.labels: 1 or more");
  require(c.states_per_step > 0, "collect.states_per_step: more than 0");
  require(c.learner.batch >= 1, "learning.batch: 1 or more");
  require(is_share(c.arena_discount.action) && is_share(c.arena_discount.distance) &&
              is_share(c.building_discount.action) && is_share(c.building_discount.distance),
          "discounts: more than 0, at most 1");
  require(c.replay_states >= static_cast<std::size_t>(c.environments),
          "collect.replay_states: at least collect.environments");
  require(c.report_every >= 1 && c.evaluate_every >= 1 && c.checkpoint_every >= 1,
          "run.report_every, run.evaluate_every, run.checkpoint_every: 1 or more");
  require(c.reward.unit_cells > 0, "reward.unit_cells: more than 0");
  require(c.worlds.max_agents >= 1 && c.worlds.max_agents <= 8, "worlds.max_agents: 1 to 8");
  const WorldMix& w = c.worlds;
  const double shares[] = {w.arena_1x,         w.arena_2x, w.divider,
                           w.divider_released, w.building, w.corridor};
  double sum = 0;
  for (const double share : shares) {
    require(share >= 0, "worlds: shares are 0 or more");
    sum += share;
  }
  require(sum > 0, "worlds: at least one share above 0");
}

}  // namespace ivfm::host

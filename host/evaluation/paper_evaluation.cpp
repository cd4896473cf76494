#include "host/evaluation/paper_evaluation.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace ivfm::host {

namespace {

// Worlds of the paired comparison: the arenas, and generated buildings, of which each one takes as
// long as dozens of arenas. At random a robot sees no building in thousands of actions.
struct ComparedWorld {
  const char* name;
  int share;  // one of so many of the episodes
  bool with_random;
};
constexpr std::array<ComparedWorld, 4> kComparedWorlds = {
    {{"1x", 1, true}, {"divider", 1, true}, {"2x", 1, true}, {"building", 10, false}}};

// Episodes of one world that all its contestants play.
struct Part {
  std::string world;
  int agents = 1;
  int episodes = 0;
  std::vector<Contestant> contestants;

  int plays() const { return episodes * static_cast<int>(contestants.size()); }
};

Part compared_part(const ComparedWorld& world, const PaperRequest& request) {
  Part part{world.name, 1, request.compared_episodes / world.share, request.contestants};
  if (!world.with_random)
    std::erase_if(part.contestants, [](const Contestant& c) { return c.policy == "random"; });
  return part;
}

// A figure of the tables that the paper has too.
struct Figure {
  const char* metric;
  std::optional<PaperValue> (*paper)(const PaperRow&);
  int digits;
  bool less_is_better;
  bool is_judged;  // marked when ours is better
};

constexpr std::array<Figure, 6> kFigures = {{
    {"rer", [](const PaperRow& r) { return std::optional(r.rer); }, 3, true, true},
    {"pe", [](const PaperRow& r) { return std::optional(r.pe); }, 0, false, true},
    {"steps", [](const PaperRow& r) { return std::optional(r.steps); }, 1, true, true},
    {"overlap", [](const PaperRow& r) { return r.overlap; }, 2, true, false},
    {"bandwidth_paper_mib", [](const PaperRow& r) { return r.bandwidth_mib; }, 2, true, false},
    {"coverage", [](const PaperRow& r) { return std::optional(r.coverage); }, 3, false, false},
}};

const NamedMetric& metric_named(std::string_view name) {
  const auto all = metrics();
  return *std::ranges::find_if(all, [&](const NamedMetric& m) { return name == m.name; });
}

// The better of the learned policies' figures; nothing where there is none.
std::optional<double> best_of_paper(const Figure& figure, const PaperSetting& setting) {
  std::optional<double> best;
  for (const PaperRow& row : setting.rows) {
    const auto value = figure.paper(row);
    if (!row.is_learned || !value) continue;
    if (!best || (value->mean < *best) == figure.less_is_better) best = value->mean;
  }
  return best;
}

std::optional<int> best_not_found(const PaperSetting& setting) {
  std::optional<int> best;
  for (const PaperRow& row : setting.rows) {
    if (row.is_learned && row.not_found)
      best = std::min(best.value_or(*row.not_found), *row.not_found);
  }
  return best;
}

std::string mean_and_error(const MeanStd& value, int digits) {
  if (value.count == 0) return "–";
  const double n = static_cast<double>(value.count);
  return with_error(value.mean, value.std / std::sqrt(n), digits);
}

TextTable::Row paper_row(const PaperSetting& setting, const PaperRow& row) {
  TextTable::Row out = {{"paper: " + row.policy}, {std::to_string(setting.agents)}};
  const double found = kPaperEpisodes - row.not_found.value_or(0);
  for (const Figure& figure : kFigures) {
    const auto value = figure.paper(row);
    TextTable::Entry entry{"–"};
    if (value) {
      // How many runs the real corridor had is not said: standard deviations there.
      const double error = row.not_found ? value->std / std::sqrt(found) : value->std;
      entry.text = value->std == 0 ? "> " + fixed(value->mean, figure.digits)
                                   : with_error(value->mean, error, figure.digits);
      if (row.pe_is_artefact && std::string_view(figure.metric) == "pe")
        entry.text += " (artefact)";
      entry.is_best = row.is_learned && figure.is_judged && setting.rows.size() > 1 &&
                      value->mean == best_of_paper(figure, setting);
    }
    out.push_back(entry);
  }
  TextTable::Entry not_found{row.not_found ? std::to_string(*row.not_found) : "–"};
  not_found.is_best = row.is_learned && row.not_found && row.not_found == best_not_found(setting);
  out.push_back(not_found);
  for (int i = 0; i < 4; ++i) out.push_back({"–"});
  return out;
}

TextTable::Row our_row(const PaperSetting& setting, const Outcome& outcome) {
  TextTable::Row out = {{outcome.contestant.label}, {std::to_string(setting.agents)}};
  const std::span<const EpisodeMetrics> episodes = outcome.result.episodes;
  for (const Figure& figure : kFigures) {
    const MeanStd value = summarized(metric_named(figure.metric), episodes);
    const bool applies = setting.agents > 1 || std::string_view(figure.metric) != "overlap";
    TextTable::Entry entry{applies ? mean_and_error(value, figure.digits) : "–"};
    const auto best = best_of_paper(figure, setting);
    entry.is_better = figure.is_judged && best && value.count > 0 && value.mean != *best &&
                      (value.mean < *best) == figure.less_is_better;
    out.push_back(entry);
  }
  const std::int64_t lost = not_found(episodes);
  const auto best_lost = best_not_found(setting);
  out.push_back({std::to_string(lost), false,
                 best_lost && (lost < *best_lost || (lost == 0 && *best_lost == 0))});
  for (const auto& [name, digits] :
       {std::pair{"makespan", 1}, {"distance_m", 2}, {"collisions", 1}}) {
    out.push_back({mean_and_error(summarized(metric_named(name), episodes), digits)});
  }
  MeanStd wire = summarized(metric_named("wire_bytes"), episodes);
  wire.mean /= 1024 * 1024;
  wire.std /= 1024 * 1024;
  out.push_back({mean_and_error(wire, 3)});
  return out;
}

// Robots with a lidar that play the corridor as the paper's camera played the arenas: the network
// alone decides, and what counts as seen lies ahead and reaches a quarter of the local map's width
// (4.8 m).
WorldOptions options_for(const std::string& world) {
  WorldOptions options;
  options.name = world;
  if (world == "corridor") {
    options.sensor_range_m = 6;
    options.visit_range_m = 1.2;
    options.visit_fov_deg = 135;
    options.network_decides = true;
  }
  return options;
}

}  // namespace

EvaluationRequest request_for(const PaperRequest& paper, const std::string& world, int agents,
                              const Contestant& contestant, int episodes) {
  EvaluationRequest request;
  request.world = make_world(options_for(world));
  request.policy = contestant.policy;
  request.model = contestant.model;
  request.state = contestant.state;
  request.agents = agents;
  request.episodes = episodes;
  request.seed = paper.seed;
  request.threads = paper.threads;
  return request;
}

PaperOutcome evaluate_paper(const PaperRequest& request, EpisodeStore& store, ProcessGroup& group,
                            const std::function<void(int, int)>& progress) {
  const auto settings = paper_settings();
  std::vector<Part> parts;
  for (const PaperSetting& setting : settings)
    parts.push_back({setting.world, setting.agents, request.episodes, request.contestants});
  if (request.compared_episodes > 0)
    for (const ComparedWorld& world : kComparedWorlds)
      parts.push_back(compared_part(world, request));
  int wanted = 0, finished = 0;
  for (const Part& part : parts) wanted += part.plays();
  const auto play = [&](const Part& part) {
    std::vector<Outcome> outcomes;
    for (const Contestant& contestant : part.contestants) {
      const EvaluationRequest row =
          request_for(request, part.world, part.agents, contestant, part.episodes);
      const auto report = [&](int done) {
        if (progress) progress(finished + done, wanted);
      };
      outcomes.push_back({contestant, evaluate(row, store, group, report)});
      finished += part.episodes;
    }
    return outcomes;
  };
  PaperOutcome outcome;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (i < settings.size())
      outcome.settings.push_back({&settings[i], play(parts[i])});
    else if (parts[i].episodes > 0)
      outcome.compared.push_back({parts[i].world, play(parts[i])});
  }
  return group.is_first() ? outcome : PaperOutcome();
}

TextTable setting_table(std::span<const SettingOutcome> settings, const std::string& table) {
  TextTable out;
  out.header = {"policy",   "agents",        "RER",       "PE",        "steps",
                "overlap",  "MiB (formula)", "coverage",  "not found", "makespan",
                "m driven", "collisions",    "MiB (wire)"};
  for (const SettingOutcome& setting : settings) {
    if (setting.paper->table != table) continue;
    for (const PaperRow& row : setting.paper->rows) {
      out.rows.push_back(paper_row(*setting.paper, row));
    }
    for (const Outcome& ours : setting.ours) out.rows.push_back(our_row(*setting.paper, ours));
  }
  return out;
}

std::vector<std::string> paper_table_names() {
  std::vector<std::string> names;
  for (const PaperSetting& setting : paper_settings()) {
    if (names.empty() || names.back() != setting.table) names.push_back(setting.table);
  }
  return names;
}

}  // namespace ivfm::host

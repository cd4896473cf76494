#include "host/evaluation/paper_document.h"

#include <fstream>
#include <stdexcept>

#include "host/evaluation/distribution_plot.h"
#include "host/evaluation/episode_story.h"
#include "host/evaluation/file_hash.h"

namespace ivfm::host {

namespace {

namespace fs = std::filesystem;

constexpr int kWorst = 5;
constexpr int kPicturePx = 700;

constexpr const char* kLegend =
    "Means over the episodes that found the target, ± one standard error (the paper's: its "
    "standard deviation over the root of its episodes; in the corridor, whose number of runs it "
    "does not say, the standard deviation). Of the paper's two learned policies the better figure "
    "is {best}; ours is {better} where it is better than that. Steps: actions of all agents; "
    "makespan: the largest number of actions of one agent. MiB (formula): the paper's bandwidth; "
    "MiB (wire): every datagram of our link, both ways and of all robots (evaluation.md). PE of an "
    "episode that finds its target after a few centimetres is huge, which lifts a mean. In "
    "the corridor the network alone decides, as in arenas, what counts as seen lies up to 1.2 m "
    "away within 135 degrees ahead, and PE scales areas and lengths by the local map's width, 4.8 "
    "m, to 1 m; these rows have an ideal lidar and exact poses (training.md has some with noise "
    "and drift).\n";

constexpr const char* kComparedLegend =
    "The same episodes for each policy; differences episode by episode, over all episodes, those "
    "without success with what they spent until the cap. Positive: we need less. {better}: by more "
    "than two standard errors. In buildings: until 99 % of the reachable area is seen.\n";

std::string filled(std::string text, const std::string& best, const std::string& better) {
  const auto replace = [&](const std::string& name, const std::string& value) {
    const std::size_t at = text.find(name);
    if (at != std::string::npos) text.replace(at, name.size(), value);
  };
  replace("{better}", better);
  replace("{best}", best);
  return text;
}

TextTable compared_table(const PaperOutcome& outcome) {
  TextTable table = comparison_table();
  for (const WorldOutcome& world : outcome.compared) {
    add_comparison(table, world.world, world.ours.front(), std::span(world.ours).subspan(1));
  }
  return table;
}

void write_text(const fs::path& path, const std::string& text) {
  std::ofstream out(path, std::ios::binary);
  if (!(out << text).flush()) throw std::runtime_error("cannot write " + path.string());
}

// Writes the document's parts one after the other.
class DocumentWriter {
 public:
  DocumentWriter(const fs::path& file, const PaperRequest& request, const PaperOutcome& outcome)
      : folder_(fs::path(file).replace_extension()), request_(request), outcome_(outcome) {
    fs::create_directories(folder_);
  }

  std::string header(const Provenance& provenance) const {
    const Contestant& judged = request_.contestants.front();
    std::string text = "# Results\n\nWritten by `" + provenance.command + "`; do not edit.\n\n";
    text += "| | |\n| --- | --- |\n| commit | " + provenance.commit + " |\n";
    if (!judged.model.empty()) {
      text += "| model | `" + judged.model.filename().string() + "`, SHA-256 `" +
              sha256_of_file(judged.model) + "` |\n";
    }
    return text + "| seed | " + std::to_string(request_.seed) + " |\n| episodes | " +
           std::to_string(request_.episodes) + " a row, " +
           std::to_string(request_.compared_episodes) + " a comparison |\n\n" +
           "How worlds, policies and measures are defined: [evaluation.md](evaluation.md).\n\n";
  }

  std::string tables() const {
    std::string text = "## The paper's tables\n" + filled(kLegend, "_in italics_", "**bold**");
    for (const std::string& name : paper_table_names()) {
      text += "\n### " + name + "\n" + setting_table(outcome_.settings, name).to_markdown();
    }
    return text + "\n";
  }

  std::string comparison() const {
    if (outcome_.compared.empty()) return {};
    return "## Against our own baselines\n" + filled(kComparedLegend, "", "**Bold**") + "\n" +
           compared_table(outcome_).to_markdown() + "\n";
  }

  std::string distributions() const {
    std::string text = "## Distribution of the steps\n";
    for (const SettingOutcome& setting : outcome_.settings) {
      if (setting.paper->agents != 1) continue;
      const std::string world = setting.paper->world;
      std::vector<Outcome> outcomes = setting.ours;
      for (const WorldOutcome& compared : outcome_.compared) {
        if (compared.world == world) outcomes = compared.ours;
      }
      write_text(folder_ / ("steps-" + world + ".svg"),
                 distribution_svg(setting.paper->table + ", one agent", outcomes));
      text += image("steps-" + world + ".svg", "Steps of every policy, " + setting.paper->table);
    }
    return text + "\n";
  }

  // An episode of median cost of some settings, and the worst ones of the first.
  std::string episodes() const {
    std::string text =
        "## Episodes\nOf median cost, by the judged policy: where the robots drove, "
        "over how often each place was seen.\n\n";
    for (const SettingOutcome& setting : outcome_.settings) {
      const PaperSetting& paper = *setting.paper;
      const bool is_shown = paper.agents == 1 || (paper.world == "2x" && paper.agents == 4);
      if (is_shown) text += median_picture(setting);
    }
    return text + worst(outcome_.settings.front());
  }

 private:
  std::string image(const std::string& name, const std::string& alt) const {
    return "![" + alt + "](" + (folder_.filename() / name).string() + ")\n";
  }

  EvaluationRequest request_of(const SettingOutcome& setting) const {
    return request_for(request_, setting.paper->world, setting.paper->agents,
                       setting.ours.front().contestant, request_.episodes);
  }

  std::string median_picture(const SettingOutcome& setting) const {
    const PaperSetting& paper = *setting.paper;
    const int number = median_episode(setting.ours.front().result.episodes);
    const EpisodeStory story = tell_episode(request_of(setting), number);
    const std::string team =
        std::to_string(paper.agents) + (paper.agents > 1 ? " agents" : " agent");
    const std::string name = "episode-" + paper.world + "-" + std::to_string(paper.agents) + ".png";
    write_png(folder_ / name,
              draw_episode(story, paper.table + ", " + team + ", episode " + std::to_string(number),
                           kPicturePx));
    return image(name, paper.table + ", " + team);
  }

  std::string worst(const SettingOutcome& setting) const {
    const EvaluationRequest request = request_of(setting);
    const auto numbers = worst_episodes(setting.ours.front().result.episodes, kWorst);
    std::string text = "\n### The worst of " + setting.paper->table + "\n";
    for (const int number : numbers) {
      const EpisodeStory story = tell_episode(request, number);
      text += "- Episode " + std::to_string(number) + ": " + explain(story) + "\n";
      if (number != numbers.front()) continue;
      const std::string title = "The worst, episode " + std::to_string(number);
      write_png(folder_ / "worst.png", draw_episode(story, title, kPicturePx));
    }
    return text + "\n" + image("worst.png", "The worst episode");
  }

  fs::path folder_;
  const PaperRequest& request_;
  const PaperOutcome& outcome_;
};

}  // namespace

std::string paper_text(const PaperOutcome& outcome) {
  std::string text = filled(kLegend, "marked *", "marked +");
  for (const std::string& name : paper_table_names()) {
    text += "\n" + name + "\n" + setting_table(outcome.settings, name).to_text();
  }
  if (outcome.compared.empty()) return text;
  return text + "\nAgainst our own baselines\n" + filled(kComparedLegend, "", "Marked +") +
         compared_table(outcome).to_text();
}

void write_paper_document(const fs::path& file, const PaperRequest& request,
                          const PaperOutcome& outcome, const Provenance& provenance) {
  const DocumentWriter writer(file, request, outcome);
  std::string text = writer.header(provenance);
  text += writer.tables();
  text += writer.comparison();
  text += writer.distributions();
  text += writer.episodes();
  write_text(file, text);
}

}  // namespace ivfm::host

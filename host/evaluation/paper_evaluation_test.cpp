#include "host/evaluation/paper_evaluation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>

#include "host/evaluation/paper_document.h"

namespace ivfm::host {
namespace {

using testing::HasSubstr;

PaperRequest small_request() {
  PaperRequest request;
  request.contestants = {{"ours", "frontier-nearest", {}, "ivfm"},
                         {"other", "frontier-median", {}, "ivfm"}};
  request.episodes = 1;
  request.compared_episodes = 0;
  return request;
}

TEST(PaperTables, HoldEveryRowOfThePaper) {
  int rows = 0;
  for (const PaperSetting& setting : paper_settings())
    rows += static_cast<int>(setting.rows.size());
  EXPECT_EQ(rows, 8 + 6 + 10 + 1);
  EXPECT_THAT(paper_table_names(),
              testing::ElementsAre("1x arena", "Divider", "2x arena", "Real corridor"));
}

TEST(SettingTable, MarksThePapersBetterFigureAndOursWhereItIsBetterStill) {
  EpisodeMetrics episode;
  episode.found = true;
  episode.rer = 0.3;   // better than both
  episode.pe = 6'100;  // better than i-VFM's 5,827 only
  episode.steps = 20;
  const PaperSetting& setting = paper_settings().front();
  const std::vector<SettingOutcome> outcome = {
      {&setting, {{{"ours", "qnet", {}, "ivfm"}, {{episode}, 1, 1}}}}};
  const TextTable table = setting_table(outcome, setting.table);
  ASSERT_EQ(table.rows.size(), 5u);
  for (const TextTable::Row& row : table.rows) EXPECT_EQ(row.size(), table.header.size());
  const TextTable::Row &vfm = table.rows[2], &ours = table.rows[4];
  EXPECT_EQ(vfm[2].text, "0.488 ± 0.042");  // 0.597 / sqrt(200)
  EXPECT_TRUE(vfm[2].is_best && vfm[3].is_best && vfm[4].is_best);
  EXPECT_FALSE(table.rows[1][3].is_best) << "the frontier row's PE is an artefact";
  EXPECT_TRUE(ours[2].is_better);
  EXPECT_FALSE(ours[3].is_better);
  EXPECT_TRUE(ours[4].is_better);
  EXPECT_EQ(ours[5].text, "–") << "one agent overlaps with nobody";
}

TEST(PaperEvaluation, WritesItsDocumentAndGoesOnWithWhatIsFinished) {
  const auto folder = std::filesystem::temp_directory_path() / "paper_evaluation_test";
  std::filesystem::remove_all(folder);
  EpisodeStore store(folder / "episodes.csv");
  ProcessGroup alone;
  const PaperRequest request = small_request();
  const PaperOutcome outcome = evaluate_paper(request, store, alone);
  const std::size_t played = store.lines().size();
  EXPECT_EQ(played, 2u * paper_settings().size());
  EXPECT_EQ(paper_text(evaluate_paper(request, store, alone)), paper_text(outcome));
  EXPECT_EQ(store.lines().size(), played) << "nothing is played twice";

  write_paper_document(folder / "results.md", request, outcome, {"0123abc", "make paper"});
  std::ifstream in(folder / "results.md");
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  for (const char* part : {"0123abc", "make paper", "### Divider", "paper: i-VFM", "- Episode "}) {
    EXPECT_THAT(text, HasSubstr(part));
  }
  for (const char* picture : {"steps-2x.svg", "worst.png", "episode-2x-4.png"}) {
    EXPECT_TRUE(std::filesystem::exists(folder / "results" / picture)) << picture;
  }
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace ivfm::host

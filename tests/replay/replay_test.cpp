// The recorded agent decides and sends the same on every machine; damaged recordings are refused.
//
// Data: *.replay and replay_model.ivfm, written by record_agent; golden_hashes.txt pins behaviour,
// it is not derived independently. After a change of behaviour on purpose: record_replays.sh.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "tests/replay/replay_player.h"

namespace ivfm::replay {
namespace {

using Bytes = std::vector<std::uint8_t>;

const std::string kFolder = std::string(IVFM_SOURCE_DIR) + "/tests/replay/";

Bytes read_file(const std::string& name) {
  std::ifstream file(kFolder + name, std::ios::binary);
  EXPECT_TRUE(file.good()) << name;
  return {std::istreambuf_iterator<char>(file), {}};
}

std::uint64_t golden_hash(const std::string& recording) {
  std::ifstream file(kFolder + "golden_hashes.txt");
  for (std::string name, hash; file >> name >> hash;) {
    if (name == recording) return std::stoull(hash, nullptr, 16);
  }
  ADD_FAILURE() << "no hash for " << recording;
  return 0;
}

class BytesSource final : public ByteSource {
 public:
  explicit BytesSource(const Bytes& bytes) : bytes_(bytes) {}
  std::size_t read(std::span<std::uint8_t> out) override {
    const std::size_t size = std::min(out.size(), bytes_.size() - position_);
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(position_), size, out.begin());
    position_ += size;
    return size;
  }

 private:
  const Bytes& bytes_;
  std::size_t position_ = 0;
};

struct Played {
  Status status = Status::kOk;
  ReplaySummary summary;
};

Played play_corridor(const Bytes& file, const Bytes& model) {
  BytesSource source(file);
  ReplayReader reader(source);
  Header header;
  Played played;
  played.status = reader.read_header(header);
  if (!ok(played.status)) return played;
  AgentReplay player(reader);
  const auto agent = std::make_unique<AgentFor<McuProfile>>(header.config, player.ports());
  EXPECT_TRUE(ok(agent->load_model(model).status));
  played.status = player.run(*agent, nullptr, played.summary);
  return played;
}

Played play_arena(const Bytes& file, const Bytes& model) {
  BytesSource source(file);
  ReplayReader reader(source);
  Header header;
  Played played;
  played.status = reader.read_header(header);
  if (!ok(played.status)) return played;
  const auto explorer = std::make_unique<ExplorerFor<PaperProfile>>(header.config.explorer);
  const auto network = std::make_unique<QNetwork>();
  EXPECT_TRUE(ok(network->load(model).status));
  played.status = replay_explorer(reader, *explorer, *network, nullptr, played.summary);
  return played;
}

TEST(RecordedAgent, DecidesAndSendsTheSameEverywhere) {
  const Played played = play_corridor(read_file("corridor.replay"), read_file("replay_model.ivfm"));
  EXPECT_EQ(played.status, Status::kOk);
  EXPECT_GE(played.summary.decisions, 100u);
  EXPECT_EQ(played.summary.unused_steps, 0u) << "the agent asks its ports differently now";
  EXPECT_EQ(played.summary.hash, golden_hash("corridor")) << std::hex << played.summary.hash;
}

TEST(RecordedAgent, MatchesScansToTheSamePosesEverywhere) {
  const Played played = play_corridor(read_file("matching.replay"), read_file("replay_model.ivfm"));
  EXPECT_EQ(played.status, Status::kOk);
  EXPECT_GE(played.summary.decisions, 50u);
  EXPECT_GE(played.summary.matched, played.summary.scans * 9 / 10);
  EXPECT_EQ(played.summary.unused_steps, 0u) << "the agent asks its ports differently now";
  EXPECT_EQ(played.summary.hash, golden_hash("matching")) << std::hex << played.summary.hash;
}

TEST(RecordedExplorer, DecidesTheSameEverywhere) {
  const Played played = play_arena(read_file("arena.replay"), read_file("replay_model.ivfm"));
  EXPECT_EQ(played.status, Status::kOk);
  EXPECT_GE(played.summary.decisions, 200u);
  EXPECT_GE(played.summary.local_goals, 100u);
  EXPECT_EQ(played.summary.hash, golden_hash("arena")) << std::hex << played.summary.hash;
}

TEST(ReplayFile, EndsEarlyWithAStatusAtEveryByte) {
  const Bytes model = read_file("replay_model.ivfm");
  Bytes file = read_file("arena.replay");
  for (const std::size_t size : {0, 7, 9, 10, 15, 16, 200, 521, 522, 1000, 5000}) {
    const Bytes part(file.begin(), file.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_EQ(play_arena(part, model).status, Status::kTruncated) << size;
  }
  file.pop_back();
  EXPECT_EQ(play_arena(file, model).status, Status::kTruncated);
}

TEST(ReplayFile, IsRefusedWithAnythingBehindIt) {
  Bytes file = read_file("arena.replay");
  file.push_back(0);
  EXPECT_EQ(play_arena(file, read_file("replay_model.ivfm")).status, Status::kCorrupt);
}

TEST(ReplayFile, IsRefusedInAnotherVersion) {
  Bytes file = read_file("arena.replay");
  file[8] = 1;
  EXPECT_EQ(play_arena(file, read_file("replay_model.ivfm")).status, Status::kUnsupported);
}

TEST(ReplayFile, ShowsEveryFlippedBit) {
  const Bytes model = read_file("replay_model.ivfm");
  const Bytes good = read_file("arena.replay");
  std::mt19937 random(3);
  for (int round = 0; round < 20; ++round) {
    Bytes file = good;
    const std::size_t byte = random() % std::min<std::size_t>(good.size(), 6000);
    file[byte] = static_cast<std::uint8_t>(file[byte] ^ (1u << random() % 8));
    EXPECT_NE(play_arena(file, model).status, Status::kOk) << byte;
  }
}

TEST(ReplayFile, SurvivesRandomBytes) {
  const Bytes model = read_file("replay_model.ivfm");
  std::mt19937 random(5);
  for (int round = 0; round < 20; ++round) {
    Bytes file = {'I', 'V', 'F', 'M', 'R', 'P', 'L', 'Y', 2, 0};
    for (int i = 0; i < 400; ++i) file.push_back(static_cast<std::uint8_t>(random()));
    EXPECT_NE(play_arena(file, model).status, Status::kOk);
    EXPECT_NE(play_corridor(file, model).status, Status::kOk);
  }
}

}  // namespace
}  // namespace ivfm::replay

// Decodes the worked examples of FORMAT.md: the document and the code cannot drift apart.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "shared/wire/datagram.h"
#include "shared/wire/map_dump.h"
#include "shared/wire/map_update.h"
#include "shared/wire/messages.h"

namespace ivfm {
namespace {

using Bytes = std::vector<std::uint8_t>;

// The bytes of the fenced block "```hex NAME"; what follows a '|' in a line is a comment.
Bytes example(const std::string& name) {
  std::ifstream file(IVFM_SOURCE_DIR "/shared/wire/FORMAT.md");
  std::string line;
  bool inside = false;
  Bytes bytes;
  while (std::getline(file, line)) {
    if (line == "```hex " + name) {
      inside = true;
    } else if (inside && line == "```") {
      return bytes;
    } else if (inside) {
      std::istringstream words(line.substr(0, line.find('|')));
      std::string word;
      while (words >> word) {
        bytes.push_back(static_cast<std::uint8_t>(std::stoul(word, nullptr, 16)));
      }
    }
  }
  ADD_FAILURE() << "FORMAT.md has no block 'hex " << name << "'";
  return bytes;
}

constexpr std::uint64_t kRobotBoot = 0x0807060504030201, kServerBoot = 0x1817161514131211;
constexpr DatagramHeader kHeader{7, 0x5f3c2a10, 258, kRobotBoot, MessageKind::kMapUpdate};
const Bytes kVisits = {0, 1, 1, 0, 0, 1, 2, 1, 0, 1, 1, 0};

Bytes wall() {
  Bytes cells(24, 0);
  std::fill(cells.begin() + 10, cells.end(), std::uint8_t{1});
  return cells;
}

TEST(FormatDocument, TheMapUpdateDecodesToWhatItsTextSays) {
  Bytes datagram = example("map-update");
  const auto opened = open_datagram(datagram, kPlainSeal, {false, kServerBoot});
  ASSERT_TRUE(opened.ok()) << to_string(opened.status());
  EXPECT_EQ(opened->header, kHeader);
  std::array<std::uint8_t, kMaxBlockCells> buffer;
  ASSERT_EQ(check_map_update(opened->body, buffer), Status::kOk);
  MapUpdateReader reader(opened->body);
  EXPECT_EQ(reader.cell_um(), 50000);
  const auto pose = unpack_pose(reader.pose());
  ASSERT_TRUE(pose.ok());
  EXPECT_EQ(pose->position, (Point{1500000, -2000000}));
  EXPECT_NEAR(pose->heading.degrees(), 90.0, 0.05);
  const auto visits = reader.next(buffer);
  ASSERT_TRUE(visits.ok());
  EXPECT_EQ(visits->layer, Layer::kVisits);
  EXPECT_EQ(visits->rect, (CellRect{-3, 5, 4, 3}));
  EXPECT_TRUE(std::ranges::equal(visits->cells, kVisits));
  const auto obstacles = reader.next(buffer);
  ASSERT_TRUE(obstacles.ok());
  EXPECT_EQ(obstacles->layer, Layer::kObstacles);
  EXPECT_EQ(obstacles->rect, (CellRect{10, -1, 24, 1}));
  EXPECT_TRUE(std::ranges::equal(obstacles->cells, wall()));
  EXPECT_EQ(reader.next(buffer).status(), Status::kEmpty);
}

TEST(FormatDocument, TheMapUpdateEncodesToTheSameBytes) {
  std::array<std::uint8_t, kMaxDatagramBytes> buffer{};
  const Pose pose{{1500000, -2000000}, BinaryAngle::from_degrees(90)};
  MapUpdateWriter writer(body_of(buffer), 50000, pack_pose(pose));
  ASSERT_EQ(writer.add(Layer::kVisits, {-3, 5, 4, 3}, kVisits), Status::kOk);
  ASSERT_EQ(writer.add(Layer::kObstacles, {10, -1, 24, 1}, wall()), Status::kOk);
  const auto size = seal_datagram(kHeader, writer.size(), buffer, kPlainSeal, kServerBoot);
  ASSERT_TRUE(size.ok());
  EXPECT_EQ(Bytes(buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(*size)),
            example("map-update"));
}

TEST(FormatDocument, TheAcknowledgementDecodesToWhatItsTextSays) {
  Bytes datagram = example("acknowledgement");
  const auto opened = open_datagram(datagram, kPlainSeal, {true, kRobotBoot});
  ASSERT_TRUE(opened.ok()) << to_string(opened.status());
  EXPECT_EQ(opened->header,
            (DatagramHeader{7, 0x5f3c0001, 40, kServerBoot, MessageKind::kServerAcknowledgement}));
  const auto ack = decode_acknowledgement(opened->body);
  ASSERT_TRUE(ack.ok());
  EXPECT_EQ(*ack, (Acknowledgement{258, 0b101}));
  EXPECT_TRUE(ack->covers(258));
  EXPECT_TRUE(ack->covers(257));
  EXPECT_FALSE(ack->covers(256));
  EXPECT_TRUE(ack->covers(255));
}

struct CollectingSink final : MapRowSink {
  std::vector<Bytes> rows;
  void take_row(Layer, std::int32_t, std::span<const std::uint8_t> cells) override {
    rows.emplace_back(cells.begin(), cells.end());
  }
};

TEST(FormatDocument, TheMapDumpDecodesToWhatItsTextSays) {
  CollectingSink sink;
  const auto header = read_map_dump(example("map-dump"), sink);
  ASSERT_TRUE(header.ok()) << to_string(header.status());
  EXPECT_EQ(*header, (MapDumpHeader{7, 0x5f3c2a10, 50000, {-3, 5, 4, 2}}));
  EXPECT_EQ(sink.rows,
            (std::vector<Bytes>{{0, 1, 1, 0}, {0, 1, 2, 1}, {0, 0, 0, 0}, {0, 0, 0, 1}}));
}

}  // namespace
}  // namespace ivfm

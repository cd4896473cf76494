// Robots with the right key that say whatever they like, to the map server on a database in memory.
// Robot 2 has told its map before; whatever robot 1 and newcomers say, it stays as it was.
#include <array>
#include <vector>

#include "host/map_server/map_server.h"
#include "tests/fuzz/fuzz_input.h"

namespace ivfm::host {
namespace {

constexpr CellRect kHonest{-20, -20, 40, 20};
constexpr std::size_t kMaxTiles = 64;
// What the server may have to send to a robot at once: a command, acknowledgements, its window's
// cells. Far less than this for each datagram that it takes.
constexpr std::size_t kMostAnswers = 64;

struct Answers final : DatagramSender {
  void send(const PeerAddress&, std::span<const std::uint8_t> datagram) override {
    ++count;
    fuzz::require(datagram.size() <= kMaxDatagramBytes, "an answer fits into a datagram");
  }
  std::size_t count = 0;
};

class Talk {
 public:
  void say(const DatagramHeader& header, std::span<const std::uint8_t> body) {
    std::vector<std::uint8_t> datagram(kMaxDatagramBytes);
    std::copy_n(body.begin(), std::min(body.size(), kMaxBodyBytes), body_of(datagram).begin());
    datagram.resize(*seal_datagram(header, std::min(body.size(), kMaxBodyBytes), datagram,
                                   kPlainSeal, server_.boot()));
    server_.receive({}, datagram, ++now_us_);
    fuzz::require(server_.map().tile_count() <= kMaxTiles, "the map stays below its limit");
    fuzz::require(server_.robot_count() <= config_.max_robots, "so do the robots");
  }
  void step(TimeUs later_us) {
    answers_.count = 0;
    server_.step(now_us_ += later_us);
    fuzz::require(answers_.count <= kMostAnswers * config_.max_robots, "answers are bounded");
  }
  void finish() { server_.finish(++now_us_); }
  std::vector<std::uint8_t> cells_of(std::uint16_t robot, const CellRect& rect) const {
    std::vector<std::uint8_t> cells;
    for (std::int32_t y = rect.y; y < rect.top(); ++y) {
      for (std::int32_t x = rect.x; x < rect.right(); ++x) {
        cells.push_back(server_.map().robot_value(robot, Layer::kVisits, {x, y}));
      }
    }
    return cells;
  }

 private:
  Answers answers_;
  RunDatabase database_{":memory:"};
  MapServerConfig config_{
      .boot = 7, .retention_us = 10'000'000, .max_robots = 4, .max_tiles = kMaxTiles};
  MapServer server_{database_, answers_, database_.begin_session(0, 1), config_};
  TimeUs now_us_ = 1;
};

std::vector<std::uint8_t> honest_map(const std::vector<std::uint8_t>& cells) {
  std::vector<std::uint8_t> body(kMaxBodyBytes);
  MapUpdateWriter writer(body, 50'000, {});
  fuzz::require(ok(writer.add(Layer::kVisits, kHonest, cells)), "the honest map can be sent");
  body.resize(writer.size());
  return body;
}

}  // namespace
}  // namespace ivfm::host

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ivfm;
  using namespace ivfm::host;
  fuzz::Input input(data, size);
  Talk talk;
  const std::vector<std::uint8_t> honest(static_cast<std::size_t>(kHonest.area()), 3);
  talk.say({2, 100, 1, 9, MessageKind::kMapUpdate}, honest_map(honest));
  talk.step(200'000);
  DatagramHeader header{1, 100, 0, 5, MessageKind::kHello};
  while (!input.empty()) {
    const std::uint8_t choice = input.byte();  // the kind, and what else happens
    const auto body = input.take(static_cast<std::size_t>(input.byte()) * 5);
    if (choice & 0x10) header.epoch += choice >> 6;
    if (choice & 0x20) talk.step(TimeUs{choice} * 20'000);
    header.robot = choice & 0x40 ? static_cast<std::uint16_t>(3 + (choice >> 7)) : 1;
    header.kind = static_cast<MessageKind>(1 + choice % 6);
    ++header.sequence;
    talk.say(header, body);
  }
  talk.step(1'000'000);
  talk.finish();
  fuzz::require(talk.cells_of(2, kHonest) == honest, "nobody else writes robot 2's map");
  return 0;
}

// Writes the fuzzers' first corpus with the encoders of this tree. Usage: fuzz_seeds FOLDER
#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "firmware/hal/linux/radio_key_file.h"
#include "firmware/hal/linux/socketcand_protocol.h"
#include "firmware/lidar/rplidar_protocol.h"
#include "firmware/nn/test_model.h"
#include "host/simulator/map_file.h"
#include "host/simulator/rplidar_emulator.h"
#include "shared/wire/datagram.h"
#include "shared/wire/map_dump.h"
#include "shared/wire/map_update.h"
#include "shared/wire/messages.h"

namespace ivfm {
namespace {

namespace fs = std::filesystem;
using Bytes = std::vector<std::uint8_t>;
fs::path folder;

void write(const std::string& fuzzer, const std::string& name, const Bytes& bytes) {
  fs::create_directories(folder / fuzzer);
  std::ofstream(folder / fuzzer / name, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
}

// A message by itself, and as the fuzzers of the link and of the server take it.
void write_message(const std::string& name, const Bytes& body, MessageKind kind) {
  write("messages", name, body);
  Bytes wrapped = {static_cast<std::uint8_t>(static_cast<unsigned>(kind) & 7u),
                   static_cast<std::uint8_t>((body.size() + 3) / 4)};
  wrapped.insert(wrapped.end(), body.begin(), body.end());
  write("link", name, wrapped);
  if (is_from_server(kind)) return;
  wrapped = {static_cast<std::uint8_t>(0x20 + static_cast<unsigned>(kind) - 1),
             static_cast<std::uint8_t>((body.size() + 4) / 5)};
  wrapped.insert(wrapped.end(), body.begin(), body.end());
  write("server", name, wrapped);
}

template <typename Message>
void write_small(const std::string& name, const Message& message, MessageKind kind) {
  Bytes body(100);
  body.resize(*encode(message, body));
  write_message(name, body, kind);
}

Bytes map_update(std::size_t before = 0) {
  Bytes body(1160);
  MapUpdateWriter writer(std::span(body).subspan(before), 50000, {});
  const Bytes smooth = {0, 1, 1, 0, 0, 1, 2, 1, 0, 1, 1, 0};
  Bytes walls(240);
  for (std::size_t i = 100; i < 130; ++i) walls[i] = 1;
  Bytes noise(64);
  for (std::size_t i = 0; i < noise.size(); ++i) noise[i] = static_cast<std::uint8_t>(i * 167u);
  static_cast<void>(writer.add(Layer::kVisits, {-3, 5, 4, 3}, smooth));
  static_cast<void>(writer.add(Layer::kObstacles, {10, -1, 24, 10}, walls));
  static_cast<void>(writer.add(Layer::kVisits, {100, 100, 8, 8}, noise));
  body.resize(before + writer.size());
  return body;
}

void write_messages() {
  Hello hello{50000, {-192, -192, 384, 384}, true, {}, 0};
  hello.set_name("robot 1");
  write_small("hello", hello, MessageKind::kHello);
  write_small("acknowledgement", Acknowledgement{258, 5}, MessageKind::kServerAcknowledgement);
  write_small("command", Command{CommandCode::kStop, 1}, MessageKind::kCommand);
  write_small("welcome", Welcome{9, false, true}, MessageKind::kWelcome);
  write_small("status", RobotStatus{}, MessageKind::kStatus);
  write_small("found", FoundReport{}, MessageKind::kFound);
  write_small("request", RestoreRequest{{0, 0, 9, 9}, {}}, MessageKind::kRestoreRequest);
  write_small("places", RobotPlaces{{RobotPlace{0x3c00, 0xbc00, 9}}, 1}, MessageKind::kPlaces);
  write_small("map_frame", MapFrame{1, {{1'000'000, -2'000'000}, BinaryAngle(30000)}},
              MessageKind::kMapFrame);
  hello.apart = true;
  write_small("hello_apart", hello, MessageKind::kHello);
  Bytes restore = map_update(kRestoreHeaderBytes);
  static_cast<void>(encode(RestoreHeader{{}, {1, 0, 0}}, restore));
  write_message("restore", restore, MessageKind::kRestore);
  write_message("map_update", map_update(), MessageKind::kServerMapUpdate);
  write("map_update", "three_regions", map_update());
}

struct Checkered final : MapRowSource {
  Status read_row(Layer layer, std::int32_t y, std::span<std::uint8_t> out) const override {
    for (std::size_t i = 0; i < out.size(); ++i) {
      out[i] = static_cast<std::uint8_t>((i + static_cast<std::size_t>(y)) % 3 *
                                         (layer == Layer::kVisits));
    }
    return Status::kOk;
  }
};
struct Collected final : ByteSink {
  Status write(std::span<const std::uint8_t> more) override {
    bytes.insert(bytes.end(), more.begin(), more.end());
    return Status::kOk;
  }
  Bytes bytes;
};

void write_lidar() {
  host::RplidarEmulator lidar;
  Bytes stream;
  TimeUs now_us = 0;
  const auto ask = [&](Bytes request, TimeUs time_us) {
    lidar.receive(request, now_us);
    const Bytes answer = lidar.transmit(now_us += time_us);
    stream.insert(stream.end(), answer.begin(), answer.end());
  };
  lidar.set_motor(true, 0);
  ask({0xa5, 0x50}, 10'000);
  ask({0xa5, 0x52}, 10'000);
  ask({0xa5, 0x20}, 30'000);
  ask({0xa5, 0x25}, 10'000);
  ask({0xa5, 0x82, 0x05, 0, 0, 0, 0, 0, 0x22}, 60'000);
  write("rplidar", "info_health_scan_express", stream);
}

void write_can() {
  Bytes frames;
  const auto frame = [&](unsigned id, const Bytes& data) {
    frames.insert(frames.end(), {static_cast<std::uint8_t>(id), static_cast<std::uint8_t>(id >> 8),
                                 static_cast<std::uint8_t>(data.size())});
    frames.insert(frames.end(), data.begin(), data.end());
    frames.insert(frames.end(), {0, 0, 9});  // time passes
  };
  for (unsigned node = 1; node <= 2; ++node) {
    frame(0x700 + node, {0});
    for (int i = 0; i < 30; ++i) frame(0x580 + node, {0x60, 0x17, 0x10, 0, 0, 0, 0, 0});
    frame(0x180 + node, {0x37, 0x02, 0, 0, 0, 0});
    frame(0x280 + node, {1, 2, 3, 4});
    frame(0x80 + node, {0x10, 0x23, 1, 0, 0, 0, 0, 0});
    frame(0x700 + node, {5});
  }
  write("can", "a_start", frames);
}

void write_texts() {
  std::array<char, kMaxSocketcandMessage> text;
  SocketcandFrame frame;
  frame.id = 0x123;
  frame.size = 2;
  frame.data = {0x11, 0x22};
  std::string stream = "0< hi >< ok >";
  stream.append(text.data(), format_socketcand_send(frame, text));
  stream.append(text.data(), format_socketcand_frame(frame, 23'424'242, text));
  frame.remote = true;
  stream.append(text.data(), format_socketcand_send(frame, text));
  write("socketcand", "frames", {stream.begin(), stream.end()});
  RadioKey key{};
  key[0] = 0xab;
  const std::string keys = format_radio_keys({{1, key}, {65535, key}});
  write("key_file", "two", {keys.begin(), keys.end()});
}

void write_map() {
  const std::vector<host::MapCell> cells(12, host::MapCell::kFree);
  const fs::path yaml = folder / "seed.yaml";
  host::write_map_file(yaml, GridFrame(50000, {0, 0, 4, 3}), cells);
  Bytes both;
  for (const char* name : {"seed.yaml", "seed.pgm"}) {
    std::ifstream file(folder / name, std::ios::binary);
    std::string content{std::istreambuf_iterator<char>(file), {}};
    if (const auto at = content.find("seed.pgm"); at != std::string::npos) {
      content.replace(at, 8, "map.pgm");
    }
    both.insert(both.end(), content.begin(), content.end());
    if (std::string(name) == "seed.yaml") both.push_back(0);
    fs::remove(folder / name);
  }
  write("map_file", "free", both);
}

int run(const char* path) {
  folder = path;
  fs::create_directories(folder);
  write_messages();
  Collected dump;
  static_cast<void>(write_map_dump({7, 1, 50000, {-3, 5, 6, 4}}, Checkered(), dump));
  dump.bytes.resize(dump.bytes.size() - 4);  // the fuzzer adds the checksum
  write("map_dump", "checkered", dump.bytes);
  write_lidar();
  write_can();
  write_texts();
  write("model", "small", TestModel().bytes());
  write_map();
  return 0;
}

}  // namespace
}  // namespace ivfm

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: fuzz_seeds FOLDER\n", stderr);
    return 2;
  }
  return ivfm::run(argv[1]);
}

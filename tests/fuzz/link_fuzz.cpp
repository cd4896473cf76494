// Raw bytes, and messages in right envelopes, to a robot's link that a server has welcomed.
#include <array>
#include <vector>

#include "firmware/link/map_link.h"
#include "tests/fuzz/fuzz_input.h"

namespace ivfm {
namespace {

struct Nowhere final : SharedMap {
  Status read_own(Layer, const CellRect&, std::span<std::uint8_t> out) const override {
    for (std::uint8_t& cell : out) cell = 1;
    return Status::kOk;
  }
  Status write_peers(Layer, const CellRect&, std::span<const std::uint8_t>) override {
    return Status::kOk;
  }
  Status restore_own(Layer, const CellRect&, std::span<const std::uint8_t>) override {
    return Status::kOk;
  }
};

struct OneDatagram final : DatagramSocket {
  Result<std::size_t> receive(std::span<std::uint8_t> buffer) override {
    if (next.empty()) return Status::kEmpty;
    const std::size_t size = std::min(next.size(), buffer.size());
    std::copy_n(next.begin(), size, buffer.begin());
    next.clear();
    return size;
  }
  Status send(std::span<const std::uint8_t>) override { return Status::kOk; }
  std::vector<std::uint8_t> next;
};

std::vector<std::uint8_t> sealed(MessageKind kind, std::uint32_t sequence,
                                 std::span<const std::uint8_t> body) {
  std::vector<std::uint8_t> buffer(kMaxDatagramBytes);
  std::copy(body.begin(), body.end(), body_of(buffer).begin());
  buffer.resize(*seal_datagram({1, 1, sequence, 2, kind}, body.size(), buffer, kPlainSeal, 1));
  return buffer;
}

}  // namespace
}  // namespace ivfm

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ivfm;
  fuzz::Input input(data, size);
  Nowhere map;
  OneDatagram socket;
  MapLink link(map, socket, {.apart = !input.empty() && (*data & 1) != 0});
  link.clip({-100, -100, 200, 200});
  std::uint32_t sequence = 0;
  TimeUs now_us = 1;
  const auto deliver = [&](std::vector<std::uint8_t> datagram) {
    socket.next = std::move(datagram);
    link.step(now_us += 100'000, {});
    if (link.take_frame()) link.move_frame();
  };
  std::array<std::uint8_t, 8> welcome;
  const std::size_t welcome_size = *encode(Welcome{1, true, true}, welcome);
  deliver(sealed(MessageKind::kWelcome, ++sequence, std::span(welcome).first(welcome_size)));
  link.mark_dirty(Layer::kVisits, {0, 0, 50, 50});
  while (!input.empty()) {
    const std::uint8_t choice = input.byte();
    const auto body = input.take(static_cast<std::size_t>(input.byte()) * 4);
    if (choice % 8 == 0) {
      deliver({body.begin(), body.end()});
    } else {
      deliver(sealed(static_cast<MessageKind>(0x80 + choice % 8), ++sequence, body));
    }
  }
  return 0;
}

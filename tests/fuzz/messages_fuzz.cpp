#include <algorithm>
#include <array>

#include "shared/wire/messages.h"
#include "tests/fuzz/fuzz_input.h"

namespace ivfm {
namespace {

template <typename Decode>
void check(std::span<const std::uint8_t> body, Decode decode) {
  const auto message = decode(body);
  if (!message.ok()) return;
  std::array<std::uint8_t, 100> out;
  const auto size = encode(*message, out);
  fuzz::require(size.ok() && std::ranges::equal(std::span(out).first(*size), body),
                "what decodes encodes to the same bytes");
}

}  // namespace
}  // namespace ivfm

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ivfm;
  const std::span body(data, size);
  check(body, decode_acknowledgement);
  check(body, decode_hello);
  check(body, decode_welcome);
  check(body, decode_restore_request);
  check(body, decode_robot_status);
  check(body, decode_found_report);
  check(body, decode_command);
  check(body, decode_robot_places);
  check(body, decode_map_frame);
  if (size >= kRestoreHeaderBytes) check(body.first(kRestoreHeaderBytes), decode_restore_header);
  return 0;
}

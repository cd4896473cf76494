#include <algorithm>
#include <array>
#include <memory>

#include "firmware/hal/linux/socketcand_protocol.h"
#include "tests/fuzz/fuzz_input.h"

namespace ivfm {
namespace {

void check(const Result<SocketcandFrame>& frame) {
  if (!frame.ok()) return;
  fuzz::require(frame->size <= 8, "a frame is bounded");
  std::array<char, kMaxSocketcandMessage> text;
  const std::size_t size = format_socketcand_send(*frame, text);
  const std::string_view inner(text.data() + 2, size - 4);  // without "< " and " >"
  const auto again = parse_socketcand_send(inner);
  fuzz::require(again.ok() && *again == *frame, "what is parsed can be sent and parsed again");
}

}  // namespace
}  // namespace ivfm

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ivfm;
  fuzz::Input input(data, size);
  const auto tokenizer = std::make_unique<SocketcandTokenizer>();
  while (!input.empty()) {
    const auto space = tokenizer->free_space();
    const auto bytes = input.take(std::min<std::size_t>(space.size(), 1 + input.byte()));
    std::copy(bytes.begin(), bytes.end(), space.begin());
    tokenizer->commit(bytes.size());
    for (auto message = tokenizer->next(); message.ok(); message = tokenizer->next()) {
      check(parse_socketcand_frame(*message));
      check(parse_socketcand_send(*message));
    }
    fuzz::require(!tokenizer->free_space().empty(), "there is room for more");
  }
  return 0;
}

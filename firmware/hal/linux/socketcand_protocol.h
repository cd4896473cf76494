// The socketcand protocol's text (linux-can/socketcand, doc/protocol.md), for client and server.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>

#include "shared/status/status.h"

namespace ivfm {

// A classic frame as the protocol carries it, with 11 or 29 bit identifier.
struct SocketcandFrame {
  std::uint32_t id = 0;
  bool extended = false;
  bool remote = false;
  std::uint8_t size = 0;  // 0 .. 8; a remote frame has a size but no data
  std::array<std::uint8_t, 8> data{};
  constexpr bool operator==(const SocketcandFrame&) const = default;
};

// Longest message of the raw mode either way, with room to spare.
inline constexpr std::size_t kMaxSocketcandMessage = 256;

// Cuts a byte stream into `< ... >` messages. What stands outside the brackets is skipped; a
// message longer than kMaxSocketcandMessage is skipped as a whole and counted.
class SocketcandTokenizer {
 public:
  // Where received bytes go; never empty after a next() that found nothing.
  std::span<char> free_space() { return std::span(buffer_).subspan(end_); }
  // Tells that `size` bytes were written to the front of free_space().
  void commit(std::size_t size) { end_ += size; }
  // The text between the brackets without surrounding blanks, e.g. "send 123 1 AA"; valid until the
  // next call of commit() or next(). kEmpty: no complete message.
  Result<std::string_view> next();
  std::uint32_t oversized() const { return oversized_; }

 private:
  void compact();

  std::array<char, 4096> buffer_{};
  std::size_t begin_ = 0;
  std::size_t end_ = 0;
  bool skipping_ = false;
  std::uint32_t oversized_ = 0;
};

// "frame 123 23.424242 11223344" (blanks between data bytes are accepted) or "rtr 123 23.424242 4",
// as a server sends them. kUnsupported: another message; kCorrupt: a malformed one.
Result<SocketcandFrame> parse_socketcand_frame(std::string_view message);
// "send 123 2 11 22" or "sendrtr 123 4", as a client sends them. Codes as above.
Result<SocketcandFrame> parse_socketcand_send(std::string_view message);

// "< send 123 2 11 22 >" or "< sendrtr 123 4 >" into `text`; returns its length. `text` must hold
// kMaxSocketcandMessage characters.
std::size_t format_socketcand_send(const SocketcandFrame& frame, std::span<char> text);
// "< frame 123 23.424242 1122 >" or "< rtr 123 23.424242 4 >" with a time in microseconds.
std::size_t format_socketcand_frame(const SocketcandFrame& frame, std::uint64_t time_us,
                                    std::span<char> text);

}  // namespace ivfm

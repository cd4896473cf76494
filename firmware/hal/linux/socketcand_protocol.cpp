#include "firmware/hal/linux/socketcand_protocol.h"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <optional>

namespace ivfm {
namespace {

constexpr bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }

// Takes the next word off `text`; empty at its end.
std::string_view take_word(std::string_view& text) {
  while (!text.empty() && is_blank(text.front())) text.remove_prefix(1);
  std::size_t size = 0;
  while (size < text.size() && !is_blank(text[size])) ++size;
  const std::string_view word = text.substr(0, size);
  text.remove_prefix(size);
  return word;
}

int hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

// A number of 1 to `max_digits` hexadecimal digits.
std::optional<std::uint32_t> parse_hex(std::string_view word, std::size_t max_digits) {
  if (word.empty() || word.size() > max_digits) return std::nullopt;
  std::uint32_t value = 0;
  for (const char c : word) {
    const int digit = hex_digit(c);
    if (digit < 0) return std::nullopt;
    value = (value << 4) | static_cast<std::uint32_t>(digit);
  }
  return value;
}

// An identifier: 8 digits name an extended one, as in the original daemon.
bool parse_id(std::string_view word, SocketcandFrame& frame) {
  const auto id = parse_hex(word, 8);
  if (!id) return false;
  frame.id = *id;
  frame.extended = word.size() == 8;
  return frame.id <= (frame.extended ? 0x1fffffffu : 0x7ffu);
}

bool parse_size(std::string_view word, SocketcandFrame& frame) {
  const auto size = parse_hex(word, 2);
  if (!size || *size > 8) return false;
  frame.size = static_cast<std::uint8_t>(*size);
  return true;
}

bool is_time(std::string_view word) {
  return !word.empty() && std::all_of(word.begin(), word.end(),
                                      [](char c) { return (c >= '0' && c <= '9') || c == '.'; });
}

// Data bytes as pairs of digits, with or without blanks between them.
bool parse_data(std::string_view text, SocketcandFrame& frame) {
  for (std::string_view word = take_word(text); !word.empty(); word = take_word(text)) {
    if (word.size() % 2 != 0) return false;
    for (std::size_t i = 0; i < word.size(); i += 2) {
      const auto byte = parse_hex(word.substr(i, 2), 2);
      if (!byte || frame.size == 8) return false;
      frame.data[frame.size++] = static_cast<std::uint8_t>(*byte);
    }
  }
  return true;
}

std::size_t put_id(const SocketcandFrame& frame, std::span<char> text) {
  return static_cast<std::size_t>(std::snprintf(
      text.data(), text.size(), frame.extended ? "%08X" : "%03X", static_cast<unsigned>(frame.id)));
}

std::size_t put_text(const char* what, std::span<char> text) {
  const std::size_t size = std::strlen(what);
  std::memcpy(text.data(), what, size);
  return size;
}

}  // namespace

void SocketcandTokenizer::compact() {
  std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
  end_ -= begin_;
  begin_ = 0;
}

Result<std::string_view> SocketcandTokenizer::next() {
  for (;;) {
    const std::string_view rest(buffer_.data() + begin_, end_ - begin_);
    if (skipping_) {  // to the end of an oversized message
      const std::size_t close = rest.find('>');
      begin_ = close == rest.npos ? end_ : begin_ + close + 1;
      skipping_ = close == rest.npos;
      if (skipping_) break;
      continue;
    }
    const std::size_t open = rest.find('<');
    if (open == rest.npos) {
      begin_ = end_;
      break;
    }
    begin_ += open;
    const std::size_t close = rest.find('>', open);
    const std::size_t length = (close == rest.npos ? rest.size() : close + 1) - open;
    if (length > kMaxSocketcandMessage) {
      ++oversized_;
      skipping_ = true;
      continue;
    }
    if (close == rest.npos) break;
    begin_ += length;
    std::string_view message = rest.substr(open + 1, length - 2);
    while (!message.empty() && is_blank(message.front())) message.remove_prefix(1);
    while (!message.empty() && is_blank(message.back())) message.remove_suffix(1);
    return message;
  }
  compact();
  return Status::kEmpty;
}

Result<SocketcandFrame> parse_socketcand_frame(std::string_view message) {
  const std::string_view kind = take_word(message);
  if (kind != "frame" && kind != "rtr") return Status::kUnsupported;
  SocketcandFrame frame;
  frame.remote = kind == "rtr";
  if (!parse_id(take_word(message), frame) || !is_time(take_word(message))) return Status::kCorrupt;
  if (frame.remote) {
    const bool good = parse_size(take_word(message), frame) && take_word(message).empty();
    return good ? Result(frame) : Result<SocketcandFrame>(Status::kCorrupt);
  }
  if (!parse_data(message, frame)) return Status::kCorrupt;
  return frame;
}

Result<SocketcandFrame> parse_socketcand_send(std::string_view message) {
  const std::string_view kind = take_word(message);
  if (kind != "send" && kind != "sendrtr") return Status::kUnsupported;
  SocketcandFrame frame;
  frame.remote = kind == "sendrtr";
  if (!parse_id(take_word(message), frame) || !parse_size(take_word(message), frame)) {
    return Status::kCorrupt;
  }
  for (std::uint8_t i = 0; i < frame.size && !frame.remote; ++i) {
    const auto byte = parse_hex(take_word(message), 2);
    if (!byte) return Status::kCorrupt;
    frame.data[i] = static_cast<std::uint8_t>(*byte);
  }
  if (!take_word(message).empty()) return Status::kCorrupt;
  return frame;
}

std::size_t format_socketcand_send(const SocketcandFrame& frame, std::span<char> text) {
  std::size_t at = put_text(frame.remote ? "< sendrtr " : "< send ", text);
  at += put_id(frame, text.subspan(at));
  at += static_cast<std::size_t>(
      std::snprintf(text.data() + at, text.size() - at, " %u", unsigned{frame.size}));
  for (std::uint8_t i = 0; i < frame.size && !frame.remote; ++i) {
    at += static_cast<std::size_t>(
        std::snprintf(text.data() + at, text.size() - at, " %02X", unsigned{frame.data[i]}));
  }
  return at + put_text(" >", text.subspan(at));
}

std::size_t format_socketcand_frame(const SocketcandFrame& frame, std::uint64_t time_us,
                                    std::span<char> text) {
  std::size_t at = put_text(frame.remote ? "< rtr " : "< frame ", text);
  at += put_id(frame, text.subspan(at));
  at +=
      static_cast<std::size_t>(std::snprintf(text.data() + at, text.size() - at, " %llu.%06llu ",
                                             static_cast<unsigned long long>(time_us / 1'000'000),
                                             static_cast<unsigned long long>(time_us % 1'000'000)));
  if (frame.remote) {
    at += static_cast<std::size_t>(
        std::snprintf(text.data() + at, text.size() - at, "%u", unsigned{frame.size}));
  }
  for (std::uint8_t i = 0; i < frame.size && !frame.remote; ++i) {
    at += static_cast<std::size_t>(
        std::snprintf(text.data() + at, text.size() - at, "%02X", unsigned{frame.data[i]}));
  }
  return at + put_text(" >", text.subspan(at));
}

}  // namespace ivfm

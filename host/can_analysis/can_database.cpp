#include "host/can_analysis/can_database.h"

#include <algorithm>
#include <cstdlib>
#include <regex>
#include <sstream>
#include <stdexcept>

#include "host/can_analysis/shipped_files.h"

namespace ivfm::host {
namespace {

[[noreturn]] void fail(int line, const std::string& text, const std::string& why) {
  throw std::runtime_error("DBC line " + std::to_string(line) + " '" + text + "' " + why);
}

DbcSignal parse_signal(const std::smatch& match, int line, const std::string& text, int size) {
  DbcSignal signal;
  signal.name = match[1];
  signal.start_bit = std::atoi(match[2].str().c_str());
  signal.bits = std::atoi(match[3].str().c_str());
  if (match[4] == "0") fail(line, text, "is in Motorola byte order, which is not supported");
  if (signal.bits < 1 || signal.start_bit + signal.bits > 8 * size) {
    fail(line, text, "does not fit into its message");
  }
  signal.is_signed = match[5] == "-";
  signal.factor = std::strtod(match[6].str().c_str(), nullptr);
  signal.offset = std::strtod(match[7].str().c_str(), nullptr);
  signal.unit = match[8];
  return signal;
}

}  // namespace

std::int64_t DbcSignal::raw(const CanLogFrame& frame) const {
  std::uint64_t all = 0;
  for (std::size_t i = 0; i < 8; ++i) all |= std::uint64_t{frame.data[i]} << (8 * i);
  const std::uint64_t mask = bits >= 64 ? ~0ull : (1ull << bits) - 1;
  const std::uint64_t value = all >> start_bit & mask;
  const bool negative = is_signed && (value >> (bits - 1) & 1u) != 0;
  return static_cast<std::int64_t>(negative ? value | ~mask : value);
}

const DbcSignal* DbcMessage::signal(std::string_view wanted) const {
  const auto found = std::find_if(signals.begin(), signals.end(),
                                  [&](const DbcSignal& s) { return s.name == wanted; });
  return found == signals.end() ? nullptr : &*found;
}

std::map<std::uint32_t, DbcMessage> parse_dbc(std::string_view text) {
  static const std::regex message_line(R"(BO_ (\d+) (\w+) *: *(\d+) +(\w+).*)");
  static const std::regex signal_line(
      R"( *SG_ (\w+)[^:]*: *(\d+)\|(\d+)@([01])([+-]) *\(([^,]+),([^)]+)\) *\[[^\]]*\] *"([^"]*)\".*)");
  static const std::regex value_line(R"(VAL_ (\d+) (\w+) (.*);.*)");
  static const std::regex value_pair(R"re((-?\d+) "([^"]*)")re");
  std::map<std::uint32_t, DbcMessage> messages;
  DbcMessage* current = nullptr;
  std::istringstream in{std::string(text)};
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    std::smatch match;
    if (line.starts_with("BO_ ")) {
      if (!std::regex_match(line, match, message_line)) fail(number, line, "is no message");
      const auto id = static_cast<std::uint32_t>(std::stoul(match[1]));
      current = &messages[id];
      *current = {id, match[2], match[4], std::atoi(match[3].str().c_str()), {}};
    } else if (line.find("SG_ ") < 4) {
      if (current == nullptr || !std::regex_match(line, match, signal_line)) {
        fail(number, line, "is no signal of a message");
      }
      current->signals.push_back(parse_signal(match, number, line, current->size));
    } else if (line.starts_with("VAL_ ") && std::regex_match(line, match, value_line)) {
      const std::string name = match[2], pairs = match[3];
      for (DbcSignal& signal : messages[static_cast<std::uint32_t>(std::stoul(match[1]))].signals) {
        if (signal.name != name) continue;
        for (std::sregex_iterator it(pairs.begin(), pairs.end(), value_pair), end; it != end;
             ++it) {
          signal.values[std::stoll((*it)[1])] = (*it)[2];
        }
      }
    }
  }
  if (messages.empty()) throw std::runtime_error("the DBC file describes no message (BO_)");
  return messages;
}

std::map<std::pair<std::uint16_t, std::uint8_t>, std::string> parse_eds(std::string_view text) {
  static const std::regex section(R"(\[([0-9A-Fa-f]{4})(?:sub([0-9A-Fa-f]+))?\]\s*)");
  std::map<std::pair<std::uint16_t, std::uint8_t>, std::string> names;
  std::istringstream in{std::string(text)};
  std::string line;
  std::pair<std::uint16_t, std::uint8_t> key;
  bool inside = false;
  while (std::getline(in, line)) {
    std::smatch match;
    if (line.starts_with("[")) {
      inside = std::regex_match(line, match, section);
      if (!inside) continue;
      key.first = static_cast<std::uint16_t>(std::stoul(match[1], nullptr, 16));
      key.second = static_cast<std::uint8_t>(
          match[2].matched ? std::stoul(match[2], nullptr, 16) & 0xffu : 0u);
    } else if (inside && line.starts_with("ParameterName=")) {
      std::string name = line.substr(line.find('=') + 1);
      while (!name.empty() && (name.back() == '\r' || name.back() == ' ')) name.pop_back();
      // A sub-index says more than the object's head.
      if (!names.contains(key) || line.find("sub") == std::string::npos) names[key] = name;
    }
  }
  return names;
}

std::string_view shipped_dbc() { return kShippedDbc; }
std::string_view shipped_eds() { return kShippedEds; }

}  // namespace ivfm::host

// What frames mean: messages and signals of a DBC file, objects of an EDS file.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "host/can_analysis/can_log.h"

namespace ivfm::host {

struct DbcSignal {
  std::string name, unit;
  int start_bit = 0, bits = 0;  // Intel byte order
  bool is_signed = false;
  double factor = 1, offset = 0;
  std::map<std::int64_t, std::string> values;  // names of raw values

  std::int64_t raw(const CanLogFrame& frame) const;
  double value(const CanLogFrame& frame) const {
    return factor * static_cast<double>(raw(frame)) + offset;
  }
};

struct DbcMessage {
  std::uint32_t id = 0;
  std::string name, sender;
  int size = 0;  // bytes
  std::vector<DbcSignal> signals;
  // Null when there is no such signal.
  const DbcSignal* signal(std::string_view wanted) const;
};

// The messages of a DBC file by identifier (bit 31: extended). Throws std::runtime_error with the
// line when a message, signal or value table cannot be understood; other lines are skipped.
std::map<std::uint32_t, DbcMessage> parse_dbc(std::string_view text);

// ParameterName by (index, subindex) of an EDS file (CiA 306).
std::map<std::pair<std::uint16_t, std::uint8_t>, std::string> parse_eds(std::string_view text);

// The files that ship with this project.
std::string_view shipped_dbc();
std::string_view shipped_eds();

}  // namespace ivfm::host

#include "host/can_analysis/can_export.h"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <functional>
#include <optional>
#include <stdexcept>

#include "host/can_analysis/can_database.h"
#include "host/can_analysis/can_log.h"

namespace ivfm::host {
namespace {

// Calls `write` for the selected frames, with their time since the first one, and closes `out`.
void export_frames(const std::filesystem::path& log, const CanSelection& selection,
                   const std::filesystem::path& out, const std::string& head,
                   const std::function<void(std::uint64_t)>& progress,
                   const std::function<void(std::ofstream&, const CanLogFrame&, double)>& write) {
  std::ofstream stream(out, std::ios::binary);
  stream << head;
  std::error_code none;
  const std::uint64_t size = std::filesystem::file_size(log, none);
  std::optional<double> first_s;
  read_can_log(
      log,
      [&](const CanLogFrame& frame) {
        if (!first_s) first_s = frame.time_s;
        const double time_s = frame.time_s - *first_s;
        if (time_s < selection.from_s || time_s > selection.to_s) return;
        if (!selection.bus.empty() && frame.bus != selection.bus) return;
        write(stream, frame, time_s);
      },
      [&](std::uint64_t bytes) {
        if (progress) progress(100 * bytes / std::max<std::uint64_t>(1, size));
      });
  stream.close();
  if (!stream) throw std::runtime_error("'" + out.string() + "' cannot be written");
}

std::string candump_line(const CanLogFrame& frame) {
  char text[64];
  std::snprintf(text, sizeof text, "(%017.6f) ", frame.time_s);
  std::string line = text + frame.bus;
  std::snprintf(text, sizeof text, frame.extended ? " %08X#" : " %03X#", frame.id);
  line += text;
  if (frame.remote) {
    line += frame.size > 0 ? "R" + std::to_string(frame.size) : "R";
  } else {
    for (std::size_t i = 0; i < frame.size; ++i) {
      std::snprintf(text, sizeof text, "%02X", frame.data[i]);
      line += text;
    }
  }
  return line + "\n";
}

}  // namespace

std::uint64_t export_candump(const std::filesystem::path& log, const CanSelection& selection,
                             const std::filesystem::path& out,
                             const std::function<void(std::uint64_t)>& progress) {
  std::uint64_t rows = 0;
  export_frames(log, selection, out, "", progress,
                [&](std::ofstream& stream, const CanLogFrame& frame, double) {
                  stream << candump_line(frame);
                  ++rows;
                });
  return rows;
}

std::uint64_t export_signals_csv(const std::filesystem::path& log, const CanSelection& selection,
                                 const std::filesystem::path& out,
                                 const std::function<void(std::uint64_t)>& progress) {
  const auto messages = parse_dbc(shipped_dbc());
  std::uint64_t rows = 0;
  export_frames(log, selection, out, "time_s,bus,message,signal,value,unit\r\n", progress,
                [&](std::ofstream& stream, const CanLogFrame& frame, double time_s) {
                  const auto found = messages.find(frame.id | (frame.extended ? 0x80000000u : 0u));
                  if (found == messages.end() || frame.remote || frame.size != found->second.size)
                    return;
                  for (const DbcSignal& signal : found->second.signals) {
                    char text[64];
                    std::snprintf(text, sizeof text, "%.6f,", time_s);
                    stream << text << frame.bus << ',' << found->second.name << ',' << signal.name
                           << ',';
                    std::snprintf(text, sizeof text, "%.10g", signal.value(frame));
                    stream << text << ',' << signal.unit << "\r\n";
                    ++rows;
                  }
                });
  return rows;
}

}  // namespace ivfm::host

// Finished episodes by what they belong to, kept in a file so that a long run can go on.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "host/evaluation/episode_metrics.h"

namespace ivfm::host {

struct EpisodeRecord {
  int episode = 0;  // its number, from 0
  EpisodeMetrics metrics;
  std::int64_t decisions = 0;
  double busy_s = 0;  // wall time that it took one thread

  bool operator==(const EpisodeRecord&) const = default;
};

// A record as one line of text without its end; reading it back gives the same bits. `key` says
// what the episode belongs to and holds no comma and no line break.
std::string to_line(const std::string& key, const EpisodeRecord& record);
// Throws std::invalid_argument when `line` is not such a line.
std::pair<std::string, EpisodeRecord> from_line(std::string_view line);

class EpisodeStore {
 public:
  using Episodes = std::map<int, EpisodeRecord>;

  EpisodeStore() = default;  // in memory only
  // Goes on with `file`; lines that cannot be read, such as one that was cut off, do not count.
  // Throws std::runtime_error when the file cannot be written.
  explicit EpisodeStore(const std::filesystem::path& file);

  // Takes a line of to_line() over, and appends it to the file. Throws std::invalid_argument for
  // another line, std::runtime_error when the disk is full.
  void add(const std::string& line);

  // Empty when nothing is known.
  const Episodes& episodes(const std::string& key) const;
  // How many of the episodes 0 .. `wanted` - 1 are there.
  int count(const std::string& key, int wanted) const;
  // Every record as a line.
  std::vector<std::string> lines() const;

 private:
  std::map<std::string, Episodes> by_key_;
  std::filesystem::path file_;
  std::ofstream out_;
};

}  // namespace ivfm::host

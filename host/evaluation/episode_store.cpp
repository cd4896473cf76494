#include "host/evaluation/episode_store.h"

#include <charconv>
#include <stdexcept>
#include <utility>

namespace ivfm::host {

namespace {

// Every field of a record, in the order of the file.
template <typename Record, typename Visit>
void for_each_field(Record& r, Visit visit) {
  auto& m = r.metrics;
  visit(r.episode), visit(r.decisions), visit(r.busy_s), visit(m.seed), visit(m.found);
  visit(m.rer), visit(m.pe), visit(m.steps), visit(m.makespan), visit(m.overlap);
  visit(m.coverage), visit(m.distance_m), visit(m.bandwidth_paper_mib), visit(m.wire_bytes);
  visit(m.sim_time_s), visit(m.collisions);
  for (auto& metres : m.milestone_m) visit(metres);
}

template <typename Number>
std::string text_of(Number value) {
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

std::string text_of(bool value) { return value ? "1" : "0"; }
std::string text_of(const std::optional<double>& value) { return value ? text_of(*value) : ""; }

template <typename Number>
void parse(std::string_view text, Number& value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) {
    throw std::invalid_argument("'" + std::string(text) + "' is not a number");
  }
}

void parse(std::string_view text, bool& value) {
  if (text != "0" && text != "1") throw std::invalid_argument("neither 0 nor 1");
  value = text == "1";
}

void parse(std::string_view text, std::optional<double>& value) {
  value.reset();
  if (!text.empty()) parse(text, value.emplace());
}

}  // namespace

std::string to_line(const std::string& key, const EpisodeRecord& record) {
  std::string line = key;
  for_each_field(record, [&](const auto& field) { (line += ',') += text_of(field); });
  return line;
}

std::pair<std::string, EpisodeRecord> from_line(std::string_view line) {
  bool has_more = true;
  const auto next = [&] {
    if (!has_more) throw std::invalid_argument("a field is missing");
    const std::size_t comma = line.find(',');
    has_more = comma != std::string_view::npos;
    const std::string_view field = line.substr(0, comma);
    if (has_more) line.remove_prefix(comma + 1);
    return field;
  };
  std::pair<std::string, EpisodeRecord> result(next(), EpisodeRecord());
  for_each_field(result.second, [&](auto& field) { parse(next(), field); });
  if (has_more) throw std::invalid_argument("a field too many");
  return result;
}

EpisodeStore::EpisodeStore(const std::filesystem::path& file) : file_(file) {
  if (file.has_parent_path()) std::filesystem::create_directories(file.parent_path());
  std::ifstream in(file);
  bool ended = true;
  for (std::string line; std::getline(in, line); ended = !in.eof()) {
    try {
      const auto [key, record] = from_line(line);
      if (!in.eof()) by_key_[key][record.episode] = record;
    } catch (const std::invalid_argument&) {
    }
  }
  out_.open(file, std::ios::app);
  if (!ended) out_ << '\n';  // ends a line that was cut off
  if (!out_.flush()) throw std::runtime_error("cannot write " + file.string());
}

void EpisodeStore::add(const std::string& line) {
  const auto [key, record] = from_line(line);
  by_key_[key][record.episode] = record;
  if (file_.empty()) return;
  if (!(out_ << line << '\n').flush()) throw std::runtime_error("cannot write " + file_.string());
}

const EpisodeStore::Episodes& EpisodeStore::episodes(const std::string& key) const {
  static const Episodes none;
  const auto found = by_key_.find(key);
  return found == by_key_.end() ? none : found->second;
}

int EpisodeStore::count(const std::string& key, int wanted) const {
  const Episodes& all = episodes(key);
  return static_cast<int>(std::distance(all.begin(), all.lower_bound(wanted)));
}

std::vector<std::string> EpisodeStore::lines() const {
  std::vector<std::string> lines;
  for (const auto& [key, episodes] : by_key_) {
    for (const auto& [number, record] : episodes) lines.push_back(to_line(key, record));
  }
  return lines;
}

}  // namespace ivfm::host

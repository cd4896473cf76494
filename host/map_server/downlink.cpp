#include "host/map_server/downlink.h"

#include <algorithm>

namespace ivfm::host {
namespace {

std::int64_t squared_distance(const CellRect& rect, Cell center) {
  const std::int64_t dx = rect.x + rect.width / 2 - std::int64_t{center.x};
  const std::int64_t dy = rect.y + rect.height / 2 - std::int64_t{center.y};
  return dx * dx + dy * dy;
}

}  // namespace

void Downlink::set_window(const CellRect& window) {
  window_ = window;
  for (auto& entry : dirty_) entry.second = entry.second.intersection(window);
  std::erase_if(dirty_, [](const auto& entry) { return entry.second.empty(); });
}

void Downlink::mark(const TileKey& key, const CellRect& rect) {
  const CellRect news = rect.intersection(window_);
  if (news.empty()) return;
  CellRect& dirty = dirty_[key];
  dirty = dirty.united(news);
}

void Downlink::expire(TimeUs now_us) {
  bool silent = false;
  for (auto it = in_flight_.begin(); it != in_flight_.end();) {
    const TimeUs sent_us = it->second.front().sent_us;
    if (now_us - sent_us < timeout_us_) {
      ++it;
      continue;
    }
    silent = silent || (sent_us >= last_acknowledged_us_ && sent_us >= backed_off_us_);
    for (const InFlight& lost : it->second) mark(lost.part.key, lost.part.rect);
    it = in_flight_.erase(it);
  }
  if (!silent) return;
  timeout_us_ = std::min(2 * timeout_us_, config_.retry_max_us);
  open_allowed_ = 1;
  backed_off_us_ = now_us;
}

void Downlink::acknowledge(const Acknowledgement& acknowledgement, TimeUs now_us) {
  std::erase_if(in_flight_, [&](const auto& entry) { return acknowledgement.covers(entry.first); });
  last_acknowledged_us_ = now_us;
  timeout_us_ = config_.retry_us;
  open_allowed_ = std::min(2 * open_allowed_, config_.max_open_datagrams);
}

bool Downlink::is_due(TimeUs now_us) const {
  return !dirty_.empty() && in_flight_.size() < open_allowed_ &&
         (last_batch_us_ == 0 || now_us - last_batch_us_ >= config_.period_us);
}

std::vector<Downlink::Part> Downlink::nearest(Cell center, std::size_t limit) const {
  std::vector<Part> parts;
  parts.reserve(dirty_.size());
  for (const auto& [key, rect] : dirty_) parts.push_back({key, rect});
  const auto nearer = [center](const Part& a, const Part& b) {
    return squared_distance(a.key.cells(), center) < squared_distance(b.key.cells(), center);
  };
  const auto count = static_cast<std::ptrdiff_t>(std::min(limit, parts.size()));
  std::partial_sort(parts.begin(), parts.begin() + count, parts.end(), nearer);
  parts.resize(static_cast<std::size_t>(count));
  return parts;
}

void Downlink::sent(const std::vector<Part>& parts, std::uint32_t sequence, TimeUs now_us) {
  if (parts.empty()) return;
  std::vector<InFlight>& flight = in_flight_[sequence];
  for (const Part& part : parts) {
    flight.push_back({part, sequence, now_us});
    dirty_.erase(part.key);
  }
}

}  // namespace ivfm::host

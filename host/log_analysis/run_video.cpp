#include "host/log_analysis/run_video.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <stdexcept>

#include "shared/wire/byte_reader.h"

namespace ivfm::host {
namespace {

constexpr int kHeaderPx = 48, kMarginCells = 8;
constexpr std::uint32_t kUnseen = 0xeef0f3, kSeen = 0x99d8c9, kFresh = 0x41ae8a, kWall = 0x1f2933;

cv::Scalar colour(std::uint32_t rgb) {
  return {double(rgb & 255), double(rgb >> 8 & 255), double(rgb >> 16)};
}

// A cell that was seen for the first time.
struct Sight {
  std::uint32_t time;  // tenths of a second
  Layer layer;
  Cell cell;
};

void read_sights(SqliteConnection& connection, std::vector<Sight>& sights) {
  SqliteStatement rows(connection, "SELECT layer, tile_x, tile_y, times FROM first_seen");
  while (rows.row()) {
    const TileKey key{static_cast<Layer>(rows.integer(0)),
                      static_cast<std::int32_t>(rows.integer(1)),
                      static_cast<std::int32_t>(rows.integer(2))};
    ByteReader reader(rows.blob(3));
    const CellRect rect = key.cells();
    for (std::int32_t i = 0; i < kTileSide * kTileSide; ++i) {
      const std::uint32_t time = reader.u32();
      if (time == 0) continue;
      sights.push_back({time - 1, key.layer, {rect.x + i % kTileSide, rect.y + i / kTileSide}});
    }
  }
}

std::vector<Sight> load_sights(SqliteConnection& connection, Warnings& warnings) {
  std::vector<Sight> sights;
  salvage(warnings, "a part of its map", [&] { read_sights(connection, sights); });
  std::sort(sights.begin(), sights.end(),
            [](const Sight& a, const Sight& b) { return a.time < b.time; });
  return sights;
}

// Draws the moments of a run one after the other.
class Film {
 public:
  Film(const std::filesystem::path& database, const VideoOptions& options)
      : connection_(open_run_database(database)),
        sights_(load_sights(connection_, warnings_)),
        poses_(connection_, "SELECT time_us, robot, x_um, y_um, heading FROM poses") {
    cell_um_ = static_cast<std::int32_t>(
        connection_.integer("SELECT value FROM meta WHERE key = 'cell_um'").value_or(0));
    if (sights_.empty() || cell_um_ <= 0) {
      throw std::runtime_error("run database '" + database.string() +
                               "' holds no map: no robot has sent one");
    }
    end_s_ = static_cast<double>(
                 connection_.integer("SELECT value FROM meta WHERE key = 'time_us'").value_or(0)) /
             1e6;
    for (const Sight& sight : sights_) content_ = content_.united(sight.cell);
    content_ = content_.grown(kMarginCells);
    scale_ = std::min(16.0, double(options.width_px) / std::max(content_.width, content_.height));
    // Encoders want even sides.
    const auto even = [](double side) { return std::max(320, int(side) & ~1); };
    const cv::Size size(even(content_.width * scale_), even(content_.height * scale_));
    map_ = cv::Mat(size, CV_8UC3, colour(kUnseen));
    trail_ = cv::Mat(size, CV_8UC3);
    trail_mask_ = cv::Mat::zeros(size, CV_8U);
    next_pose();
  }

  const Warnings& warnings() const { return warnings_; }
  double end_s() const { return end_s_; }
  cv::Size size() const { return {map_.cols, map_.rows + kHeaderPx}; }

  // The moment `time_s`; moments come in order.
  cv::Mat draw(double time_s) {
    advance(time_s);
    cv::Mat frame(size(), CV_8UC3, colour(0xffffff));
    cv::Mat place = frame(cv::Rect(0, kHeaderPx, map_.cols, map_.rows));
    map_.copyTo(place);
    trail_.copyTo(place, trail_mask_);
    for (const auto& [id, robot] : robots_) draw_robot(place, robot);
    const double cell_m = cell_um_ / 1e6;
    char text[96];
    std::snprintf(text, sizeof text, "%.0f s   %.1f m² explored", time_s,
                  static_cast<double>(explored_) * cell_m * cell_m);
    draw_text(frame, text, 16, 32, 20, 0x1f2933);
    return frame;
  }

 private:
  struct Robot {
    std::size_t index = 0;
    Pose pose;
  };

  void advance(double time_s) {
    // What came since the last moment shines.
    for (const Sight& sight : fresh_) paint(sight, kSeen);
    fresh_.clear();
    for (; next_ < sights_.size() && sights_[next_].time <= time_s * 10; ++next_) {
      const Sight& sight = sights_[next_];
      explored_ += sight.layer == Layer::kVisits ? 1 : 0;
      paint(sight, sight.layer == Layer::kVisits ? kFresh : kWall);
      fresh_.push_back(sight);
    }
    for (; more_poses_ && static_cast<double>(poses_.integer(0)) <= time_s * 1e6; next_pose()) {
      take_pose();
    }
  }

  void next_pose() {
    more_poses_ = false;
    salvage(warnings_, "a part of its poses", [this] { more_poses_ = poses_.row(); });
  }

  void paint(const Sight& sight, std::uint32_t rgb) {
    if (sight.layer == Layer::kObstacles) rgb = kWall;
    const auto at = [&](std::int32_t cells) { return static_cast<int>(cells * scale_); };
    const std::int32_t x = sight.cell.x - content_.x, y = content_.top() - 1 - sight.cell.y;
    cv::rectangle(map_, cv::Rect(cv::Point(at(x), at(y)), cv::Point(at(x + 1), at(y + 1))),
                  colour(rgb), cv::FILLED);
  }

  cv::Point place_of(Point p) const {
    return {static_cast<int>((double(p.x_um) / cell_um_ - content_.x) * scale_),
            static_cast<int>((content_.top() - double(p.y_um) / cell_um_) * scale_)};
  }

  void take_pose() {
    const auto id = static_cast<std::uint16_t>(poses_.integer(1));
    const Pose pose{{static_cast<std::int32_t>(poses_.integer(2)),
                     static_cast<std::int32_t>(poses_.integer(3))},
                    BinaryAngle(static_cast<std::uint16_t>(poses_.integer(4)))};
    const auto [it, is_new] = robots_.try_emplace(id, Robot{robots_.size(), pose});
    if (!is_new) {
      const cv::Point from = place_of(it->second.pose.position), to = place_of(pose.position);
      cv::line(trail_, from, to, colour(robot_rgb(it->second.index)), 2, cv::LINE_8);
      cv::line(trail_mask_, from, to, 255, 2, cv::LINE_8);
    }
    it->second.pose = pose;
  }

  void draw_robot(cv::Mat& place, const Robot& robot) const {
    const cv::Point middle = place_of(robot.pose.position);
    const double heading = robot.pose.heading.radians();
    const cv::Point tip(middle.x + static_cast<int>(16 * std::cos(heading)),
                        middle.y - static_cast<int>(16 * std::sin(heading)));
    cv::line(place, middle, tip, colour(robot_rgb(robot.index)), 3, cv::LINE_AA);
    cv::circle(place, middle, 8, colour(0xffffff), cv::FILLED, cv::LINE_AA);
    cv::circle(place, middle, 6, colour(robot_rgb(robot.index)), cv::FILLED, cv::LINE_AA);
  }

  SqliteConnection connection_;
  Warnings warnings_;
  std::vector<Sight> sights_, fresh_;
  SqliteStatement poses_;
  bool more_poses_ = false;
  std::int32_t cell_um_ = 0;
  double end_s_ = 0, scale_ = 1;
  CellRect content_;
  cv::Mat map_, trail_, trail_mask_;
  std::size_t next_ = 0;
  std::uint64_t explored_ = 0;
  std::map<std::uint16_t, Robot> robots_;
};

// H.264 where there is an encoder, which every player shows, else MPEG-4.
cv::VideoWriter open_writer(const std::filesystem::path& mp4, int frames_per_s, cv::Size size) {
  for (const char* codec : {"avc1", "mp4v"}) {
    cv::VideoWriter writer(mp4.string(), cv::CAP_FFMPEG,
                           cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]),
                           frames_per_s, size);
    if (writer.isOpened()) return writer;
  }
  throw std::runtime_error("video '" + mp4.string() + "' cannot be written");
}

}  // namespace

Warnings write_run_video(const std::filesystem::path& database, const std::filesystem::path& mp4,
                         const VideoOptions& options, const LoadProgress& progress) {
  Film film(database, options);
  cv::VideoWriter writer = open_writer(mp4, options.frames_per_s, film.size());
  const int frames = std::max(2, static_cast<int>(options.length_s * options.frames_per_s));
  for (int i = 0; i < frames; ++i) {
    writer.write(film.draw(film.end_s() * i / (frames - 1)));
    if (progress) progress(static_cast<std::uint64_t>(i + 1));
  }
  return film.warnings();
}

}  // namespace ivfm::host

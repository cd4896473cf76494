#include "host/log_analysis/map_picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <opencv2/freetype.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace ivfm::host {
namespace {

constexpr const char* kFont = "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf";

constexpr std::array<std::uint32_t, 8> kRobotColours{0xd9480f, 0x6741d9, 0x1971c2, 0xc2255c,
                                                     0x846358, 0x0b7285, 0xe67700, 0x364fc7};
constexpr std::uint32_t kUnknown = 0xeef0f3, kUnexplored = 0xffffff, kObstacle = 0x1f2933;
constexpr std::uint32_t kInk = 0x1f2933, kFaintInk = 0x66707c, kOutline = 0xb4bcc6;
// From one visit to many.
constexpr std::array<std::uint32_t, 5> kHeat{0xd5efe6, 0x99d8c9, 0x41ae8a, 0x1b7f5c, 0x00441b};

cv::Vec3b bgr(std::uint32_t rgb) {
  return {static_cast<std::uint8_t>(rgb), static_cast<std::uint8_t>(rgb >> 8),
          static_cast<std::uint8_t>(rgb >> 16)};
}

cv::Scalar scalar(std::uint32_t rgb) {
  const cv::Vec3b c = bgr(rgb);
  return {double(c[0]), double(c[1]), double(c[2])};
}

// The heat of a share 0..1 of the scale.
cv::Vec3b heat(double share) {
  const double place = std::clamp(share, 0.0, 1.0) * (kHeat.size() - 1);
  const auto low = std::min(static_cast<std::size_t>(place), kHeat.size() - 2);
  const double t = place - static_cast<double>(low);
  const cv::Vec3b a = bgr(kHeat[low]), b = bgr(kHeat[low + 1]);
  cv::Vec3b out;
  for (int i = 0; i < 3; ++i) out[i] = cv::saturate_cast<std::uint8_t>(a[i] + t * (b[i] - a[i]));
  return out;
}

// Counts spread over decades: the scale is logarithmic.
double heat_share(int visits, int most) {
  return most > 1 ? std::log(double(visits)) / std::log(double(most)) : 0;
}

// Text in the DejaVu font where it is installed, else in OpenCV's own stroke font.
class TextPen {
 public:
  TextPen() {
    if (!std::filesystem::exists(kFont)) return;
    font_ = cv::freetype::createFreeType2();
    font_->loadFontData(kFont, 0);
  }

  // `left` and `baseline` in pixels. Returns the right end.
  int write(cv::Mat& image, const std::string& text, int left, int baseline, int height,
            std::uint32_t colour) {
    if (text.empty()) return left;
    if (font_) {
      font_->putText(image, text, {left, baseline}, height, scalar(colour), cv::FILLED, cv::LINE_AA,
                     true);
      return left + font_->getTextSize(text, height, cv::FILLED, nullptr).width;
    }
    const double scale = height / 30.0;
    cv::putText(image, text, {left, baseline}, cv::FONT_HERSHEY_SIMPLEX, scale, scalar(colour), 1,
                cv::LINE_AA);
    return left + cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, scale, 1, nullptr).width;
  }

 private:
  cv::Ptr<cv::freetype::FreeType2> font_;
};

// The cells that are worth showing.
CellRect content_of(const PictureLayers& layers, const PictureOptions& options) {
  CellRect content;
  for (std::size_t i = 0; i < layers.frame.size(); ++i) {
    if (layers.visits[i] || layers.obstacles[i]) {
      content = content.united(layers.frame.cell_of_index(i));
    }
  }
  if (options.world != nullptr) {
    const GridFrame& frame = layers.frame;
    const World& world = *options.world;
    const auto end = [](std::int32_t origin, std::int32_t cells, std::int32_t cell) {
      return origin + cells * cell - 1;
    };
    content = content.united(frame.cell_at(world.origin));
    content = content.united(frame.cell_at({end(world.origin.x_um, world.width, world.cell_um),
                                            end(world.origin.y_um, world.height, world.cell_um)}));
  }
  return content;
}

class MapPainter {
 public:
  MapPainter(const PictureLayers& layers, const PictureOptions& options)
      : layers_(layers), options_(options) {
    content_ = content_of(layers, options);
    if (content_.empty()) throw std::invalid_argument("the map is empty: nothing to draw");
    content_ = content_.grown(std::max(4, std::max(content_.width, content_.height) / 100));
    const int longer = std::max(content_.width, content_.height);
    cell_px_ = std::clamp((options.width_px + longer / 2) / longer, 1, 48);
    most_ = 1;
    for (const std::uint16_t visits : layers.visits) most_ = std::max(most_, int{visits});
    unit_ = std::max(1.0, std::max(content_.width, content_.height) * cell_px_ / 1600.0);
  }

  cv::Mat paint(std::span<const Trajectory> trajectories) {
    const cv::Mat map = paint_cells();
    const int header = px(options_.subtitle.empty() ? 56 : 84), legend = px(84), side = px(24);
    picture_ = cv::Mat(map.rows + header + legend, std::max(map.cols + 2 * side, px(900)), CV_8UC3,
                       scalar(0xffffff));
    map_at_ = {side, header};
    map.copyTo(picture_(cv::Rect(map_at_, map.size())));
    cv::rectangle(picture_, cv::Rect(map_at_, map.size()), scalar(kOutline), 1);
    pen_.write(picture_, options_.title, side, px(36), px(24), kInk);
    pen_.write(picture_, options_.subtitle, side, px(66), px(16), kFaintInk);
    for (std::size_t i = 0; i < trajectories.size(); ++i) paint_path(trajectories[i], i);
    for (std::size_t i = 0; i < trajectories.size(); ++i) paint_goals(trajectories[i], i);
    for (std::size_t i = 0; i < trajectories.size(); ++i) paint_ends(trajectories[i], i);
    paint_scale_bar(map.size());
    paint_legend(trajectories, header + map.rows + px(34));
    return picture_;
  }

 private:
  int px(double at_1600) const { return static_cast<int>(std::lround(at_1600 * unit_)); }

  cv::Vec3b colour_of(Cell cell) const {
    if (layers_.frame.contains(cell)) {
      const std::size_t i = layers_.frame.index_of(cell);
      if (layers_.obstacles[i]) return bgr(kObstacle);
      if (layers_.visits[i]) return heat(heat_share(layers_.visits[i], most_));
    }
    if (options_.world != nullptr && !options_.world->is_occupied(layers_.frame.center_of(cell))) {
      return bgr(kUnexplored);
    }
    return bgr(kUnknown);
  }

  cv::Mat paint_cells() const {
    cv::Mat cells(content_.height, content_.width, CV_8UC3);
    for (int y = 0; y < content_.height; ++y) {
      for (int x = 0; x < content_.width; ++x) {
        cells.at<cv::Vec3b>(content_.height - 1 - y, x) =
            colour_of({content_.x + x, content_.y + y});
      }
    }
    cv::Mat map;
    cv::resize(cells, map, {}, cell_px_, cell_px_, cv::INTER_NEAREST);
    return map;
  }

  // A place in the map frame as a pixel with 4 fractional bits, as OpenCV's shift = 4 wants it.
  cv::Point place_q4(Point p) const {
    const double cell_um = layers_.frame.cell_um();
    const double x = map_at_.x + (p.x_um / cell_um - content_.x) * cell_px_;
    const double y = map_at_.y + (content_.top() - p.y_um / cell_um) * cell_px_;
    return {static_cast<int>(std::lround(x * 16)), static_cast<int>(std::lround(y * 16))};
  }

  void paint_path(const Trajectory& trajectory, std::size_t robot) {
    std::vector<cv::Point> line;
    for (const Point& p : trajectory.points) line.push_back(place_q4(p));
    if (line.size() < 2) return;
    cv::polylines(picture_, line, false, scalar(0xffffff), px(4.2), cv::LINE_AA, 4);
    cv::polylines(picture_, line, false, scalar(kRobotColours[robot % kRobotColours.size()]),
                  px(2.2), cv::LINE_AA, 4);
  }

  void paint_goals(const Trajectory& trajectory, std::size_t robot) {
    const cv::Scalar colour = scalar(kRobotColours[robot % kRobotColours.size()]);
    const cv::Rect paper(0, 0, picture_.cols, picture_.rows);
    for (const Point& goal : trajectory.goals) {
      const cv::Point q4 = place_q4(goal);
      const cv::Point at(q4.x / 16, q4.y / 16);
      if (!paper.contains(at)) continue;
      cv::drawMarker(picture_, at, scalar(0xffffff), cv::MARKER_TILTED_CROSS, px(9), px(3));
      cv::drawMarker(picture_, at, colour, cv::MARKER_TILTED_CROSS, px(8), px(1.4), cv::LINE_AA);
    }
  }

  void start_marker(cv::Point center_q4, std::size_t robot) {
    const cv::Scalar colour = scalar(kRobotColours[robot % kRobotColours.size()]);
    cv::circle(picture_, center_q4, px(7) * 16, scalar(0xffffff), cv::FILLED, cv::LINE_AA, 4);
    cv::circle(picture_, center_q4, px(6) * 16, colour, px(2.5), cv::LINE_AA, 4);
  }

  void end_marker(cv::Point center_q4, std::size_t robot) {
    const cv::Scalar colour = scalar(kRobotColours[robot % kRobotColours.size()]);
    cv::circle(picture_, center_q4, px(8.5) * 16, scalar(0xffffff), cv::FILLED, cv::LINE_AA, 4);
    cv::circle(picture_, center_q4, px(7) * 16, colour, cv::FILLED, cv::LINE_AA, 4);
  }

  void paint_ends(const Trajectory& trajectory, std::size_t robot) {
    if (trajectory.points.empty()) return;
    start_marker(place_q4(trajectory.points.front()), robot);
    if (trajectory.points.size() > 1) end_marker(place_q4(trajectory.points.back()), robot);
  }

  // A bar of 1, 2 or 5 times a power of ten metres, at most a fifth of the picture.
  void paint_scale_bar(cv::Size map) {
    const double metre_px = cell_px_ * 1e6 / layers_.frame.cell_um();
    double length_m = 0.01;
    for (const double candidate : {0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0}) {
      if (candidate * metre_px <= map.width / 5.0) length_m = candidate;
    }
    const int length = static_cast<int>(std::lround(length_m * metre_px));
    const int right = map_at_.x + map.width - px(20), bottom = map_at_.y + map.height - px(18);
    const cv::Scalar ink = scalar(kInk);
    cv::line(picture_, {right - length, bottom}, {right, bottom}, ink, px(2), cv::LINE_AA);
    for (const int x : {right - length, right}) {
      cv::line(picture_, {x, bottom - px(6)}, {x, bottom}, ink, px(2), cv::LINE_AA);
    }
    char text[16];
    std::snprintf(text, sizeof text, "%g m", length_m);
    pen_.write(picture_, text, right - length, bottom - px(12), px(15), kInk);
  }

  int swatch(int left, int baseline, std::uint32_t colour, const std::string& text) {
    const cv::Rect box(left, baseline - px(14), px(16), px(16));
    cv::rectangle(picture_, box, scalar(colour), cv::FILLED);
    cv::rectangle(picture_, box, scalar(kOutline), 1);
    return pen_.write(picture_, text, left + px(24), baseline, px(15), kInk) + px(28);
  }

  int heat_bar(int left, int baseline) {
    left = pen_.write(picture_, "visits  1", left, baseline, px(15), kInk) + px(8);
    const int width = px(150);
    for (int x = 0; x < width; ++x) {
      const cv::Vec3b c = heat(double(x) / width);
      cv::line(picture_, {left + x, baseline - px(13)}, {left + x, baseline + px(2)},
               cv::Scalar(c[0], c[1], c[2]), 1);
    }
    return pen_.write(picture_, std::to_string(most_), left + width + px(8), baseline, px(15),
                      kInk) +
           px(28);
  }

  void paint_legend(std::span<const Trajectory> trajectories, int baseline) {
    int left = heat_bar(map_at_.x, baseline);
    left = swatch(left, baseline, kObstacle, "obstacle seen");
    if (options_.world != nullptr) left = swatch(left, baseline, kUnexplored, "not visited");
    swatch(left, baseline, kUnknown, options_.world ? "outside" : "unknown");
    left = map_at_.x;
    baseline += px(32);
    for (std::size_t i = 0; i < trajectories.size(); ++i) {
      const int y = baseline - px(5);
      const cv::Scalar colour = scalar(kRobotColours[i % kRobotColours.size()]);
      cv::line(picture_, {left + px(8), y}, {left + px(52), y}, colour, px(3), cv::LINE_AA);
      start_marker({(left + px(8)) * 16, y * 16}, i);
      end_marker({(left + px(52)) * 16, y * 16}, i);
      left = pen_.write(picture_, trajectories[i].label, left + px(68), baseline, px(15), kInk) +
             px(28);
    }
    if (!trajectories.empty()) {
      const bool goals = std::any_of(trajectories.begin(), trajectories.end(),
                                     [](const Trajectory& t) { return !t.goals.empty(); });
      pen_.write(picture_, std::string("ring: start, disc: end") + (goals ? ", cross: goal" : ""),
                 left, baseline, px(15), kFaintInk);
    }
  }

  const PictureLayers& layers_;
  const PictureOptions& options_;
  CellRect content_;
  int cell_px_ = 1;
  int most_ = 1;      // the largest visit count
  double unit_ = 1;   // pixels a unit of the layout, which is made for 1600 pixels
  cv::Point map_at_;  // upper left corner of the map in the picture
  cv::Mat picture_;
  TextPen pen_;
};

}  // namespace

cv::Mat draw_map_picture(const PictureLayers& layers, std::span<const Trajectory> trajectories,
                         const PictureOptions& options) {
  if (layers.visits.size() != layers.frame.size() ||
      layers.obstacles.size() != layers.frame.size()) {
    throw std::invalid_argument("draw_map_picture: the layers do not have the frame's size");
  }
  return MapPainter(layers, options).paint(trajectories);
}

void write_png(const std::filesystem::path& path, const cv::Mat& image) {
  bool written = false;
  try {
    written = cv::imwrite(path.string(), image, {cv::IMWRITE_PNG_COMPRESSION, 9});
  } catch (const cv::Exception&) {
  }
  if (!written) throw std::runtime_error("picture " + path.string() + " cannot be written");
}

std::uint32_t robot_rgb(std::size_t index) { return kRobotColours[index % kRobotColours.size()]; }

std::string robot_colour(std::size_t index) {
  char text[8];
  std::snprintf(text, sizeof text, "#%06x", robot_rgb(index));
  return text;
}

int draw_text(cv::Mat& image, const std::string& text, int left, int baseline, int height,
              std::uint32_t rgb) {
  static TextPen pen;
  return pen.write(image, text, left, baseline, height, rgb);
}

}  // namespace ivfm::host

// Pictures of explored maps: visit heat, obstacles, trajectories, legend and scale bar.
#pragma once

#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "host/environment/world.h"
#include "shared/geometry/grid_frame.h"

namespace ivfm::host {

// What was explored, row by row from the lowest row of `frame`'s window.
struct PictureLayers {
  GridFrame frame;
  std::vector<std::uint16_t> visits;    // times a cell was visited; 0: never
  std::vector<std::uint8_t> obstacles;  // 1: held to be occupied
};

// Where one robot went, in the map frame. The first point is drawn as the start, the last as the
// end; goals as small crosses.
struct Trajectory {
  std::string label;
  std::vector<Point> points;
  std::vector<Point> goals = {};
};

struct PictureOptions {
  std::string title;
  std::string subtitle;
  const World* world = nullptr;  // when given, the true free space is drawn under the map
  int width_px = 2400;           // about this wide or high, whichever is longer
};

// Draws the map, north up, cut to what is known (or to the world) and a margin. Throws
// std::invalid_argument when a layer's size does not fit the frame or nothing is to be drawn.
cv::Mat draw_map_picture(const PictureLayers& layers, std::span<const Trajectory> trajectories,
                         const PictureOptions& options);

// Writes an image as PNG; throws std::runtime_error with the path when it cannot.
void write_png(const std::filesystem::path& path, const cv::Mat& image);

// The colour of robot `index` (0 ..) in pictures and reports, and as a CSS colour such as
// "#d9480f".
std::uint32_t robot_rgb(std::size_t index);
std::string robot_colour(std::size_t index);

// Writes UTF-8 text; `left`, `baseline` and `height` in pixels. Returns the right end.
int draw_text(cv::Mat& image, const std::string& text, int left, int baseline, int height,
              std::uint32_t rgb);

}  // namespace ivfm::host

#include "host/log_analysis/map_picture.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

namespace ivfm::host {
namespace {

// 20 x 10 cells of 5 cm whose lower left corner is at (-0.5, 1.0) m.
PictureLayers small_map() {
  PictureLayers layers{GridFrame(50'000, {-10, 20, 20, 10}), {}, {}};
  layers.visits.assign(200, 0);
  layers.obstacles.assign(200, 0);
  for (std::size_t i = 0; i < 20; ++i) layers.obstacles[i] = 1;   // the lowest row
  for (std::size_t i = 100; i < 110; ++i) layers.visits[i] = 1;   // left half of a row
  for (std::size_t i = 110; i < 120; ++i) layers.visits[i] = 30;  // right half
  return layers;
}

bool has_colour(const cv::Mat& picture, cv::Vec3b bgr) {
  cv::Mat mask;
  cv::inRange(picture, bgr, bgr, mask);
  return cv::countNonZero(mask) > 0;
}

TEST(MapPicture, ShowsObstaclesBelowAndHeatAboveNorthUp) {
  PictureOptions options;
  options.width_px = 28 * 16;
  const cv::Mat picture = draw_map_picture(small_map(), {}, options);
  const cv::Vec3b obstacle(0x33, 0x29, 0x1f);
  // 20 x 6 cells are known, 4 more on each side, 16 px each; the header is 56 px high.
  const int left = 24, top = 56, cell = 16;
  const auto at = [&](int column, int row_from_top) {
    return picture.at<cv::Vec3b>(top + row_from_top * cell + 8, left + column * cell + 8);
  };
  EXPECT_EQ(at(4, 4 + 5), obstacle);  // lowest row of the content
  EXPECT_EQ(at(23, 4 + 5), obstacle);
  EXPECT_EQ(at(4, 4), cv::Vec3b(0xe6, 0xef, 0xd5));   // row 5: one visit
  EXPECT_EQ(at(23, 4), cv::Vec3b(0x1b, 0x44, 0x00));  // the most visits
}

TEST(MapPicture, DrawsTrajectoriesInTheRobotsColours) {
  const std::vector<Trajectory> paths{{"robot 1", {{-400'000, 1'250'000}, {400'000, 1'250'000}}},
                                      {"robot 2", {{0, 1'300'000}}}};
  const cv::Mat picture = draw_map_picture(small_map(), paths, {"title", "subtitle"});
  EXPECT_EQ(robot_colour(0), "#d9480f");
  EXPECT_TRUE(has_colour(picture, {0x0f, 0x48, 0xd9}));
  EXPECT_TRUE(has_colour(picture, {0xd9, 0x41, 0x67}));
}

TEST(MapPicture, ShowsTheTrueFreeSpaceThatWasNotVisited) {
  const World world{"w", 50'000, 40, 40, {-1'000'000, 0}, std::vector<std::uint8_t>(1600, 0)};
  PictureOptions options;
  options.world = &world;
  const cv::Mat with = draw_map_picture(small_map(), {}, options);
  const cv::Mat without = draw_map_picture(small_map(), {}, {});
  EXPECT_GT(with.rows, without.rows);
}

TEST(MapPicture, RefusesWhatItCannotDraw) {
  PictureLayers layers = small_map();
  layers.visits.pop_back();
  EXPECT_THROW(draw_map_picture(layers, {}, {}), std::invalid_argument);
  layers = {GridFrame(50'000, {0, 0, 2, 2}), {0, 0, 0, 0}, {0, 0, 0, 0}};
  EXPECT_THROW(draw_map_picture(layers, {}, {}), std::invalid_argument);
  EXPECT_THROW(write_png("/nowhere/x.png", cv::Mat(1, 1, CV_8U)), std::runtime_error);
}

}  // namespace
}  // namespace ivfm::host

#include "host/simulator/corridor_world.h"

#include <mrpt/maps/COccupancyGridMap2D.h>
#include <mrpt/maps/CSimpleMap.h>
#include <mrpt/poses/CPose3DPDF.h>

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace ivfm::host {
namespace {

constexpr const char* kDatasets = "/usr/share/mrpt/datasets/";

mrpt::maps::CSimpleMap load_recording(const std::filesystem::path& path) {
  if (!std::filesystem::exists(path)) {
    throw std::runtime_error("recording " + path.string() +
                             " is missing: install Debian's package mrpt-common");
  }
  mrpt::maps::CSimpleMap recording;
  if (!recording.loadFromFile(path.string()) || recording.empty()) {
    throw std::runtime_error("recording " + path.string() + " is not an MRPT simple map");
  }
  return recording;
}

// What the scans say about each cell; rows from the lowest up.
struct Evidence {
  cv::Mat free;      // 255 where beams passed
  cv::Mat occupied;  // 255 where beams ended
  std::int32_t origin_x_cells = 0;
  std::int32_t origin_y_cells = 0;
};

Evidence collect_evidence(const RecordedWorldRecipe& recipe,
                          const mrpt::maps::CSimpleMap& recording) {
  const float cell_m = static_cast<float>(recipe.cell_um) / 1e6f;
  mrpt::maps::COccupancyGridMap2D grid(-1, 1, -1, 1, cell_m);
  grid.insertionOptions.maxDistanceInsertion = static_cast<float>(recipe.max_range_m);
  grid.insertionOptions.maxOccupancyUpdateCertainty = 0.7f;
  grid.loadFromSimpleMap(recording);
  const auto width = static_cast<int>(grid.getSizeX()), height = static_cast<int>(grid.getSizeY());
  Evidence evidence;
  evidence.free = cv::Mat(height, width, CV_8U, cv::Scalar(0));
  evidence.occupied = cv::Mat(height, width, CV_8U, cv::Scalar(0));
  evidence.origin_x_cells = static_cast<std::int32_t>(std::lround(grid.getXMin() / cell_m));
  evidence.origin_y_cells = static_cast<std::int32_t>(std::lround(grid.getYMin() / cell_m));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const float free_probability = grid.getCell(x, y);
      if (free_probability > 0.55f) evidence.free.at<std::uint8_t>(y, x) = 255;
      if (free_probability < 0.45f) evidence.occupied.at<std::uint8_t>(y, x) = 255;
    }
  }
  return evidence;
}

cv::Mat disc(int radius_cells) {
  const int side = 2 * radius_cells + 1;
  cv::Mat kernel(side, side, CV_8U, cv::Scalar(0));
  for (int y = -radius_cells; y <= radius_cells; ++y) {
    for (int x = -radius_cells; x <= radius_cells; ++x) {
      if (x * x + y * y <= radius_cells * (radius_cells + 1)) {
        kernel.at<std::uint8_t>(y + radius_cells, x + radius_cells) = 1;
      }
    }
  }
  return kernel;
}

// Turns connected obstacles of at most `max_cells` into free space.
void remove_speckle(cv::Mat& free, int max_cells) {
  cv::Mat labels, statistics, centroids;
  const cv::Mat obstacles = 255 - free;
  const int count = cv::connectedComponentsWithStats(obstacles, labels, statistics, centroids, 8);
  for (int y = 0; y < free.rows; ++y) {
    for (int x = 0; x < free.cols; ++x) {
      const int label = labels.at<int>(y, x);
      if (label > 0 && label < count && statistics.at<int>(label, cv::CC_STAT_AREA) <= max_cells) {
        free.at<std::uint8_t>(y, x) = 255;
      }
    }
  }
}

// Keeps the connected part of `free` that holds the cell (x, y).
void keep_part_with(cv::Mat& free, int x, int y) {
  cv::Mat labels;
  cv::connectedComponents(free, labels, 4);
  const int wanted = labels.at<int>(y, x);
  if (wanted == 0) throw std::runtime_error("the recording's first pose is not in free space");
  free = labels == wanted;
}

cv::Mat clean(const RecordedWorldRecipe& recipe, const Evidence& evidence, int start_x,
              int start_y) {
  // The fans of far beams have gaps: unknown cells among free ones, but never where a beam ended.
  cv::Mat free;
  cv::morphologyEx(evidence.free, free, cv::MORPH_CLOSE, disc(2));
  free.setTo(0, evidence.occupied);
  remove_speckle(free, recipe.speckle_cells);
  cv::morphologyEx(free, free, cv::MORPH_OPEN, disc(recipe.seal_radius_cells));
  keep_part_with(free, start_x, start_y);
  return free;
}

}  // namespace

World build_recorded_world(const RecordedWorldRecipe& recipe) {
  const mrpt::maps::CSimpleMap recording = load_recording(recipe.simple_map);
  const Evidence evidence = collect_evidence(recipe, recording);
  const auto first = recording.begin()->pose->getMeanVal();
  const double cell_m = recipe.cell_um / 1e6;
  const cv::Mat free = clean(
      recipe, evidence, static_cast<int>(std::floor(first.x() / cell_m)) - evidence.origin_x_cells,
      static_cast<int>(std::floor(first.y() / cell_m)) - evidence.origin_y_cells);

  constexpr int kBorderCells = 4;
  const cv::Rect box = cv::boundingRect(free);
  World world;
  world.name = recipe.name;
  world.cell_um = recipe.cell_um;
  world.width = box.width + 2 * kBorderCells;
  world.height = box.height + 2 * kBorderCells;
  world.origin = {(evidence.origin_x_cells + box.x - kBorderCells) * recipe.cell_um,
                  (evidence.origin_y_cells + box.y - kBorderCells) * recipe.cell_um};
  world.occupied.assign(static_cast<std::size_t>(world.width) * world.height, 1);
  for (int y = 0; y < box.height; ++y) {
    for (int x = 0; x < box.width; ++x) {
      if (free.at<std::uint8_t>(box.y + y, box.x + x) == 0) continue;
      world.occupied[static_cast<std::size_t>(y + kBorderCells) * world.width + x + kBorderCells] =
          0;
    }
  }
  return world;
}

World corridor_world() {
  RecordedWorldRecipe recipe;
  recipe.name = "corridor";
  recipe.simple_map = std::string(kDatasets) + "localization_demo.simplemap.gz";
  return build_recorded_world(recipe);
}

World malaga_world() {
  RecordedWorldRecipe recipe;
  recipe.name = "malaga";
  recipe.simple_map = std::string(kDatasets) + "malaga-cs-fac-building.simplemap.gz";
  return build_recorded_world(recipe);
}

std::vector<Pose> corridor_start_poses(int count) {
  if (count < 1 || count > 8) {
    throw std::invalid_argument("the corridor has start poses for 1 to 8 robots");
  }
  std::vector<Pose> poses;
  for (int i = 0; i < count; ++i) {
    const bool east = i % 2 == 0;
    const std::int32_t aside_um = 400'000 + 600'000 * (i / 2);
    poses.push_back({{2'000'000 + (east ? aside_um : -aside_um), -11'000'000},
                     BinaryAngle::from_degrees(east ? 0 : 180)});
  }
  return poses;
}

}  // namespace ivfm::host

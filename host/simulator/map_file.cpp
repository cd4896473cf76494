#include "host/simulator/map_file.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace ivfm::host {
namespace {

namespace fs = std::filesystem;
using Bytes = std::vector<std::uint8_t>;

[[noreturn]] void fail(const fs::path& path, const std::string& what) {
  throw std::runtime_error("map file " + path.string() + ": " + what);
}

Bytes read_bytes(const fs::path& path, std::uintmax_t limit) {
  std::error_code error;
  if (!fs::is_regular_file(path, error)) fail(path, "there is no such file");
  const std::uintmax_t size = fs::file_size(path, error);
  if (error) fail(path, "cannot be read: " + error.message());
  if (size > limit) {
    fail(path, std::to_string(size) + " bytes, more than the " + std::to_string(limit) +
                   " that a file of this kind may have");
  }
  std::ifstream in(path, std::ios::binary);
  Bytes bytes(size);
  if (!in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size))) {
    fail(path, "cannot be read");
  }
  return bytes;
}

// An image in shades from 0 (black) to 1 (white), rows from the top; negative = transparent.
struct Shades {
  std::int32_t width = 0;
  std::int32_t height = 0;
  std::vector<float> values;
};

void check_size(const fs::path& path, std::int64_t width, std::int64_t height) {
  if (width < 1 || height < 1) fail(path, "the image is empty");
  if (width > kMaxMapSide || height > kMaxMapSide || width * height > kMaxMapCells) {
    fail(path, "the image has " + std::to_string(width) + " x " + std::to_string(height) +
                   " pixels; at most " + std::to_string(kMaxMapSide) + " a side and " +
                   std::to_string(kMaxMapCells) + " in all are read");
  }
}

// Reads netpbm's graymaps (https://netpbm.sourceforge.net/doc/pgm.html), binary P5 and plain P2.
class PgmReader {
 public:
  PgmReader(const fs::path& path, const Bytes& bytes) : path_(path), bytes_(bytes) {}

  Shades read() {
    const bool binary = bytes_[1] == '5';
    position_ = 2;
    const std::int64_t width = number("width"), height = number("height");
    const std::int64_t max_value = number("largest grey value");
    check_size(path_, width, height);
    if (max_value < 1 || max_value > 65535) fail(path_, "the largest grey value must be 1..65535");
    Shades shades{static_cast<std::int32_t>(width), static_cast<std::int32_t>(height), {}};
    if (binary) {
      ++position_;  // the single white space after the header
      read_binary(shades, max_value);
    } else {
      read_plain(shades, max_value);
    }
    return shades;
  }

 private:
  void skip_space_and_comments() {
    while (position_ < bytes_.size()) {
      const std::uint8_t c = bytes_[position_];
      if (c == '#') {
        while (position_ < bytes_.size() && bytes_[position_] != '\n') ++position_;
      } else if (c == ' ' || (c >= '\t' && c <= '\r')) {
        ++position_;
      } else {
        return;
      }
    }
  }

  std::int64_t number(const char* what) {
    skip_space_and_comments();
    const std::size_t begin = position_;
    std::int64_t value = 0;
    while (position_ < bytes_.size() && bytes_[position_] >= '0' && bytes_[position_] <= '9') {
      value = value * 10 + (bytes_[position_++] - '0');
      if (position_ - begin > 9) fail(path_, std::string("the ") + what + " is too large");
    }
    if (position_ == begin) {
      fail(path_, std::string("not a PGM file, or cut off: no ") + what + " at byte " +
                      std::to_string(begin));
    }
    return value;
  }

  void read_binary(Shades& shades, std::int64_t max_value) {
    const std::size_t sample_bytes = max_value > 255 ? 2 : 1;
    const auto count = static_cast<std::size_t>(shades.width) * shades.height;
    if (position_ > bytes_.size() || bytes_.size() - position_ < count * sample_bytes) {
      fail(path_, "cut off: the header promises " + std::to_string(count * sample_bytes) +
                      " bytes of pixels");
    }
    shades.values.reserve(count);
    for (std::size_t i = 0; i < count; ++i) {
      std::int64_t value = bytes_[position_++];
      if (sample_bytes == 2) value = value << 8 | bytes_[position_++];
      push(shades, value, max_value);
    }
  }

  void read_plain(Shades& shades, std::int64_t max_value) {
    const auto count = static_cast<std::size_t>(shades.width) * shades.height;
    if (bytes_.size() < count) fail(path_, "cut off: fewer bytes than pixels");
    shades.values.reserve(count);
    for (std::size_t i = 0; i < count; ++i) push(shades, number("pixel"), max_value);
  }

  void push(Shades& shades, std::int64_t value, std::int64_t max_value) {
    if (value > max_value) {
      fail(path_, "pixel " + std::to_string(shades.values.size()) + " is " + std::to_string(value) +
                      ", above the largest grey value " + std::to_string(max_value));
    }
    shades.values.push_back(static_cast<float>(value) / static_cast<float>(max_value));
  }

  const fs::path& path_;
  const Bytes& bytes_;
  std::size_t position_ = 0;
};

std::uint32_t big_endian32(const Bytes& bytes, std::size_t at) {
  return std::uint32_t{bytes[at]} << 24 | std::uint32_t{bytes[at + 1]} << 16 |
         std::uint32_t{bytes[at + 2]} << 8 | bytes[at + 3];
}

// The mean of the colour channels; a fully transparent pixel is unknown.
float shade_of(const cv::Mat& image, int row, int column, int channels) {
  const bool wide = image.depth() == CV_16U;
  const auto value = [&](int c) {
    return wide ? static_cast<float>(image.ptr<std::uint16_t>(row)[column * channels + c]) / 65535
                : static_cast<float>(image.ptr<std::uint8_t>(row)[column * channels + c]) / 255;
  };
  const int colours = channels >= 3 ? 3 : 1;
  if ((channels == 4 || channels == 2) && value(channels - 1) == 0) return -1;
  float sum = 0;
  for (int c = 0; c < colours; ++c) sum += value(c);
  return sum / static_cast<float>(colours);
}

Shades read_png(const fs::path& path, const Bytes& bytes) {
  // Width and height stand in the IHDR chunk, which must come first (PNG specification, 11.2.2):
  // checked before the decoder may reserve memory for them.
  if (bytes.size() < 33) fail(path, "cut off: shorter than a PNG header");
  check_size(path, big_endian32(bytes, 16), big_endian32(bytes, 20));
  cv::Mat image;
  try {
    image = cv::imdecode(bytes, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception& error) {
    fail(path, "damaged PNG image: " + error.err);
  }
  if (image.empty() || (image.depth() != CV_8U && image.depth() != CV_16U)) {
    fail(path, "damaged or cut off PNG image");
  }
  Shades shades{image.cols, image.rows, {}};
  shades.values.reserve(image.total());
  for (int row = 0; row < image.rows; ++row) {
    for (int column = 0; column < image.cols; ++column) {
      shades.values.push_back(shade_of(image, row, column, image.channels()));
    }
  }
  return shades;
}

Shades read_image(const fs::path& path) {
  const Bytes bytes = read_bytes(path, kMaxMapBytes);
  if (bytes.size() >= 2 && bytes[0] == 'P' && (bytes[1] == '5' || bytes[1] == '2')) {
    return PgmReader(path, bytes).read();
  }
  constexpr std::array<std::uint8_t, 8> kPngSignature{0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  if (bytes.size() >= 8 && std::equal(kPngSignature.begin(), kPngSignature.end(), bytes.begin())) {
    return read_png(path, bytes);
  }
  fail(path, "is neither a PGM (P5, P2) nor a PNG image");
}

// The keys of a map_server YAML file; a bare image has these values but its own path.
struct MapDescription {
  fs::path image;
  double resolution_m = 0;
  double origin_x_m = 0;
  double origin_y_m = 0;
  bool negate = false;
  double occupied_threshold = 0.65;
  double free_threshold = 0.196;
};

template <typename T>
T required(const fs::path& path, const YAML::Node& root, const char* key) {
  const YAML::Node node = root[key];
  if (!node) fail(path, std::string("the key '") + key + "' is missing");
  try {
    return node.as<T>();
  } catch (const YAML::Exception&) {
    fail(path, std::string("the value of '") + key + "' (line " +
                   std::to_string(node.Mark().line + 1) + ") has the wrong type");
  }
}

YAML::Node parse_yaml(const fs::path& path) {
  const Bytes bytes = read_bytes(path, kMaxYamlBytes);
  try {
    return YAML::Load(std::string(bytes.begin(), bytes.end()));
  } catch (const YAML::Exception& error) {
    fail(path, std::string("is not valid YAML: ") + error.what());
  }
}

bool read_negate(const fs::path& path, const YAML::Node& root) {
  const auto text = required<std::string>(path, root, "negate");
  if (text == "0" || text == "false") return false;
  if (text == "1" || text == "true") return true;
  fail(path, "'negate' must be 0 or 1, not '" + text + "'");
}

MapDescription read_description(const fs::path& path) {
  const YAML::Node root = parse_yaml(path);
  if (!root.IsMap()) fail(path, "must be a YAML mapping with image, resolution, origin, ...");
  MapDescription map;
  map.image = required<std::string>(path, root, "image");
  if (map.image.is_relative()) map.image = path.parent_path() / map.image;
  map.resolution_m = required<double>(path, root, "resolution");
  const auto origin = required<std::vector<double>>(path, root, "origin");
  if (origin.size() != 3) fail(path, "'origin' must have three numbers: [x, y, yaw]");
  if (std::abs(origin[2]) > 1e-6) fail(path, "a rotated map (yaw of 'origin' not 0) is not read");
  map.origin_x_m = origin[0];
  map.origin_y_m = origin[1];
  map.negate = read_negate(path, root);
  map.occupied_threshold = required<double>(path, root, "occupied_thresh");
  map.free_threshold = required<double>(path, root, "free_thresh");
  if (!(map.free_threshold > 0 && map.free_threshold <= map.occupied_threshold &&
        map.occupied_threshold < 1)) {
    fail(path, "the thresholds must be 0 < free_thresh <= occupied_thresh < 1");
  }
  if (root["mode"] && required<std::string>(path, root, "mode") == "raw") {
    fail(path, "mode 'raw' is not read; use 'trinary' or 'scale'");
  }
  return map;
}

std::int32_t micrometres(const fs::path& path, double metres, const char* what) {
  if (!(std::abs(metres) <= 2000)) {
    fail(path, std::string(what) + " is beyond 2 km from the map's origin");
  }
  return static_cast<std::int32_t>(std::llround(metres * 1e6));
}

World make_world(const fs::path& path, const MapDescription& map) {
  if (!(map.resolution_m >= 0.001 && map.resolution_m <= 10)) {
    fail(path, "the resolution must be 0.001 to 10 metres a cell");
  }
  const Shades shades = read_image(map.image);
  micrometres(path, map.origin_x_m + map.resolution_m * shades.width, "the right edge");
  micrometres(path, map.origin_y_m + map.resolution_m * shades.height, "the upper edge");
  World world;
  world.name = path.stem().string();
  world.cell_um = micrometres(path, map.resolution_m, "the resolution");
  world.width = shades.width;
  world.height = shades.height;
  world.origin = {micrometres(path, map.origin_x_m, "'origin' x"),
                  micrometres(path, map.origin_y_m, "'origin' y")};
  world.occupied.reserve(shades.values.size());
  for (std::int32_t row = shades.height - 1; row >= 0; --row) {
    for (std::int32_t column = 0; column < shades.width; ++column) {
      const float shade = shades.values[static_cast<std::size_t>(row) * shades.width + column];
      const double occupancy = map.negate ? shade : 1.0 - shade;
      const bool is_free = shade >= 0 && occupancy < map.free_threshold;
      world.occupied.push_back(is_free ? 0 : 1);
    }
  }
  return world;
}

double metres(std::int64_t um) { return static_cast<double>(um) / 1e6; }

void write_bytes(const fs::path& path, const std::string& bytes) {
  std::ofstream out(path, std::ios::binary);
  out << bytes;
  out.close();
  if (!out) fail(path, "cannot be written");
}

struct GridToWrite {
  std::int32_t width, height, cell_um;
  std::int64_t origin_x_um, origin_y_um;
};

void write_grid(const fs::path& yaml_path, const GridToWrite& grid, std::span<const MapCell> cells,
                MapImageFormat format) {
  const auto count = static_cast<std::size_t>(grid.width) * static_cast<std::size_t>(grid.height);
  if (cells.size() != count) throw std::invalid_argument("write_map_file: wrong number of cells");
  cv::Mat image(grid.height, grid.width, CV_8U);
  for (std::int32_t y = 0; y < grid.height; ++y) {
    std::uint8_t* row = image.ptr<std::uint8_t>(grid.height - 1 - y);
    for (std::int32_t x = 0; x < grid.width; ++x) {
      row[x] = static_cast<std::uint8_t>(cells[static_cast<std::size_t>(y) * grid.width + x]);
    }
  }
  std::vector<std::uint8_t> encoded;
  const char* extension = format == MapImageFormat::kPng ? ".png" : ".pgm";
  if (!cv::imencode(extension, image, encoded)) fail(yaml_path, "the image cannot be encoded");
  const fs::path image_path = fs::path(yaml_path).replace_extension(extension);
  write_bytes(image_path, std::string(encoded.begin(), encoded.end()));

  YAML::Emitter yaml;
  yaml.SetDoublePrecision(10);
  yaml << YAML::BeginMap;
  yaml << YAML::Key << "image" << YAML::Value << image_path.filename().string();
  yaml << YAML::Key << "mode" << YAML::Value << "trinary";
  yaml << YAML::Key << "resolution" << YAML::Value << metres(grid.cell_um);
  yaml << YAML::Key << "origin" << YAML::Value << YAML::Flow << YAML::BeginSeq
       << metres(grid.origin_x_um) << metres(grid.origin_y_um) << 0 << YAML::EndSeq;
  yaml << YAML::Key << "negate" << YAML::Value << 0;
  yaml << YAML::Key << "occupied_thresh" << YAML::Value << 0.65;
  yaml << YAML::Key << "free_thresh" << YAML::Value << 0.196;
  yaml << YAML::EndMap;
  write_bytes(yaml_path, std::string(yaml.c_str()) + '\n');
}

}  // namespace

World load_map_file(const fs::path& path, std::optional<double> resolution_m) {
  const std::string extension = path.extension().string();
  if (extension == ".yaml" || extension == ".yml") {
    const MapDescription map = read_description(path);
    if (resolution_m && std::abs(*resolution_m - map.resolution_m) > 1e-9) {
      fail(path, "states its own resolution; leave the option --resolution out");
    }
    return make_world(path, map);
  }
  if (!resolution_m) {
    fail(path, "an image alone has no scale: give --resolution in metres a pixel");
  }
  MapDescription map;
  map.image = path;
  map.resolution_m = *resolution_m;
  return make_world(path, map);
}

void write_map_file(const fs::path& yaml_path, const GridFrame& frame,
                    std::span<const MapCell> cells, MapImageFormat format) {
  const CellRect& window = frame.window();
  const std::int64_t cell_um = frame.cell_um();
  write_grid(yaml_path,
             {window.width, window.height, frame.cell_um(), window.x * cell_um, window.y * cell_um},
             cells, format);
}

void write_map_file(const fs::path& yaml_path, const World& world, MapImageFormat format) {
  std::vector<MapCell> cells;
  cells.reserve(world.occupied.size());
  for (const std::uint8_t occupied : world.occupied) {
    cells.push_back(occupied ? MapCell::kOccupied : MapCell::kFree);
  }
  write_grid(yaml_path,
             {world.width, world.height, world.cell_um, world.origin.x_um, world.origin.y_um},
             cells, format);
}

}  // namespace ivfm::host

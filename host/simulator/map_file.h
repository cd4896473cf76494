// Map files of ROS map_server (YAML with PGM or PNG) and bare PGM/PNG images: reading and writing.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>

#include "host/environment/world.h"
#include "shared/geometry/grid_frame.h"

namespace ivfm::host {

// Bounds on what is read, so that a broken or hostile file cannot exhaust memory.
inline constexpr std::int32_t kMaxMapSide = 16384;                 // cells
inline constexpr std::int64_t kMaxMapCells = 64 * 1024 * 1024;     // 8192 x 8192
inline constexpr std::uintmax_t kMaxMapBytes = 256 * 1024 * 1024;  // image file
inline constexpr std::uintmax_t kMaxYamlBytes = 64 * 1024;

// Loads `path`: `.yaml`/`.yml` in the format of ROS map_server (http://wiki.ros.org/map_server,
// section "Map format"; modes trinary and scale), else an image, which then needs `resolution_m`
// (metres a cell) and has its lower left corner at (0, 0) and dark pixels as obstacles. A YAML file
// states its own resolution: giving another one is an error. Unknown cells count as obstacles.
// Throws std::runtime_error that says what is wrong, where, and what would be right.
World load_map_file(const std::filesystem::path& path,
                    std::optional<double> resolution_m = std::nullopt);

// A cell of a map to write, as map_server's own saver colours it.
enum class MapCell : std::uint8_t { kOccupied = 0, kUnknown = 205, kFree = 254 };

enum class MapImageFormat { kPgm, kPng };

// Writes `cells` (row by row from the lowest row of `frame`'s window) as YAML at `yaml_path` and an
// image with the same stem beside it. Throws std::runtime_error when a file cannot be written,
// std::invalid_argument when the sizes differ.
void write_map_file(const std::filesystem::path& yaml_path, const GridFrame& frame,
                    std::span<const MapCell> cells, MapImageFormat format = MapImageFormat::kPgm);

// The same for a world; its origin need not be a multiple of its cell.
void write_map_file(const std::filesystem::path& yaml_path, const World& world,
                    MapImageFormat format = MapImageFormat::kPgm);

}  // namespace ivfm::host

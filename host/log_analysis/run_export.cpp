#include "host/log_analysis/run_export.h"

#include <cstdio>
#include <fstream>
#include <stdexcept>

#include "host/log_analysis/svg_chart.h"
#include "host/simulator/map_file.h"

namespace ivfm::host {
namespace {

namespace fs = std::filesystem;

void need_map(const RunData& run) {
  if (run.explored_cells + run.obstacle_cells > 0) return;
  throw std::runtime_error("run database '" + run.name + "' holds no map: no robot has sent one");
}

void close_checked(std::ofstream& out, const fs::path& path) {
  out.close();
  if (!out) throw std::runtime_error("'" + path.string() + "' cannot be written");
}

// RFC 4180: quoted when it must be.
std::string csv_field(const std::string& text) {
  if (text.find_first_of("\",\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + "\"";
}

template <typename OnRow>
void export_table(SqliteConnection& connection, const std::string& table, const fs::path& file,
                  OnRow on_row, Warnings& warnings) {
  SqliteStatement rows(connection, ("SELECT * FROM " + table).c_str());
  std::ofstream out(file);
  const int columns = rows.column_count();
  for (int i = 0; i < columns; ++i) out << (i ? "," : "") << csv_field(rows.column_name(i));
  out << "\r\n";
  salvage(warnings, "a part of its table " + table, [&] {
    while (rows.row()) {
      for (int i = 0; i < columns; ++i) out << (i ? "," : "") << csv_field(rows.text(i));
      out << "\r\n";
      on_row();
    }
  });
  close_checked(out, file);
}

// Rows of equal cells as one rectangle each.
template <typename Wanted>
std::string cell_path(const LayerMap& map, Wanted wanted) {
  std::string path;
  char text[64];
  for (std::int32_t y = 0; y < map.bounds.height; ++y) {
    for (std::int32_t x = 0; x < map.bounds.width;) {
      const auto at = [&](std::int32_t column) {
        return wanted(static_cast<std::size_t>(y) * static_cast<std::size_t>(map.bounds.width) +
                      static_cast<std::size_t>(column));
      };
      if (!at(x)) {
        ++x;
        continue;
      }
      const std::int32_t begin = x;
      while (x < map.bounds.width && at(x)) ++x;
      const std::int32_t from_top = map.bounds.height - 1 - y;
      std::snprintf(text, sizeof text, "M%d %dh%dv1h-%dz", begin, from_top, x - begin, x - begin);
      path += text;
    }
  }
  return path;
}

std::string polyline(const RunData& run, const std::vector<Point>& points) {
  std::string text;
  char place[48];
  for (const Point& p : points) {
    std::snprintf(place, sizeof place, "%.2f,%.2f ", p.x_um / 1e6 / run.cell_m - run.map.bounds.x,
                  run.map.bounds.top() - p.y_um / 1e6 / run.cell_m);
    text += place;
  }
  return text;
}

}  // namespace

Warnings export_ros_map(const fs::path& database, const fs::path& yaml,
                        const LoadProgress& progress) {
  const RunData run = load_run(database, progress);
  need_map(run);
  std::vector<MapCell> cells;
  for (std::size_t i = 0; i < run.map.visits.size(); ++i) {
    cells.push_back(run.map.obstacles[i] != 0 ? MapCell::kOccupied
                    : run.map.visits[i] != 0  ? MapCell::kFree
                                              : MapCell::kUnknown);
  }
  write_map_file(yaml, GridFrame(run.map.cell_um, run.map.bounds), cells);
  return run.warnings;
}

Warnings export_csv(const fs::path& database, const fs::path& folder,
                    const LoadProgress& progress) {
  SqliteConnection connection = open_run_database(database);
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw std::runtime_error("folder '" + folder.string() + "' cannot be created");
  std::vector<std::string> tables;
  SqliteStatement names(connection,
                        "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT IN "
                        "('tiles', 'first_seen') ORDER BY name");
  while (names.row()) tables.push_back(names.text(0));
  std::uint64_t done = 0, total = 1;
  Warnings warnings, ignored;
  for (const std::string& table : tables) {
    const std::string sql = "SELECT count(*) FROM " + table;
    salvage(ignored, table, [&] {
      total += static_cast<std::uint64_t>(connection.integer(sql.c_str()).value_or(0));
    });
  }
  const auto count_row = [&] {
    if (progress && ++done % 4096 == 0) progress(100 * done / total);
  };
  for (const std::string& table : tables) {
    export_table(connection, table, folder / (table + ".csv"), count_row, warnings);
  }
  return warnings;
}

Warnings export_svg(const fs::path& database, const fs::path& svg, const LoadProgress& progress) {
  const RunData run = load_run(database, progress);
  need_map(run);
  const CellRect& bounds = run.map.bounds;
  std::ofstream out(svg);
  out << "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" << bounds.width << "mm\" height=\""
      << bounds.height << "mm\" viewBox=\"0 0 " << bounds.width << ' ' << bounds.height
      << "\">\n<title>" << html_escaped(run.name) << "</title>\n"
      << "<desc>One unit is " << run.cell_m << " m; the lower left corner is at x "
      << bounds.x * run.cell_m << " m, y " << bounds.y * run.cell_m << " m.</desc>\n"
      << "<path id=\"visited\" fill=\"#d5efe6\" d=\""
      << cell_path(run.map, [&](std::size_t i) { return run.map.visits[i] != 0; })
      << "\"/>\n<path id=\"obstacles\" fill=\"#1f2933\" d=\""
      << cell_path(run.map, [&](std::size_t i) { return run.map.obstacles[i] != 0; }) << "\"/>\n";
  for (std::size_t i = 0; i < run.robots.size(); ++i) {
    const RobotRun& robot = run.robots[i];
    out << "<g id=\"robot" << robot.robot << "\"><title>" << html_escaped(robot.name)
        << "</title><polyline fill=\"none\" stroke=\"" << robot_colour(i)
        << "\" stroke-width=\"1.2\" points=\"" << polyline(run, robot.path) << "\"/></g>\n";
  }
  out << "</svg>\n";
  close_checked(out, svg);
  return run.warnings;
}

}  // namespace ivfm::host

#include "host/simulator/truth_log.h"

#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>

namespace ivfm::host {
namespace {

constexpr const char* kHeader = "time_s,robot,x_m,y_m,heading_deg,travelled_m,collisions,unix_us";

}  // namespace

TruthLog::TruthLog(const std::filesystem::path& path) : path_(path), out_(path, std::ios::trunc) {
  out_ << kHeader << '\n' << std::flush;
  if (!out_) throw std::runtime_error("truth log " + path.string() + " cannot be written");
}

void TruthLog::record(const Simulation& simulation, std::int64_t unix_us) {
  if (simulation.now_us() < next_us_) return;
  next_us_ = simulation.now_us() + kPeriodUs;
  char line[160];
  for (const auto& robot : simulation.robots()) {
    const RobotBody& body = robot->body();
    std::snprintf(line, sizeof line, "%.3f,%d,%.4f,%.4f,%.2f,%.4f,%d,%lld\n",
                  static_cast<double>(simulation.now_us()) / 1e6, robot->number(), body.pose().x_m,
                  body.pose().y_m, body.pose().heading_rad * 180 / M_PI, body.travelled_m(),
                  body.collisions(), static_cast<long long>(unix_us));
    out_ << line;
  }
  out_.flush();
  if (!out_) throw std::runtime_error("truth log " + path_.string() + " cannot be written");
}

std::vector<TruthRow> read_truth_log(const std::filesystem::path& path) {
  std::ifstream in(path);
  std::string line;
  if (!std::getline(in, line) || line != kHeader) {
    throw std::runtime_error("truth log " + path.string() + " is missing or does not begin with " +
                             kHeader);
  }
  std::vector<TruthRow> rows;
  while (std::getline(in, line) && !in.eof()) {
    TruthRow row;
    double heading_deg = 0;
    long long unix_us = 0;
    const int fields = std::sscanf(line.c_str(), "%lf,%d,%lf,%lf,%lf,%lf,%d,%lld", &row.time_s,
                                   &row.robot, &row.pose.x_m, &row.pose.y_m, &heading_deg,
                                   &row.travelled_m, &row.collisions, &unix_us);
    if (fields != 8 || row.robot < 1) continue;
    row.unix_us = unix_us;
    row.pose.heading_rad = heading_deg * M_PI / 180;
    rows.push_back(row);
  }
  return rows;
}

}  // namespace ivfm::host

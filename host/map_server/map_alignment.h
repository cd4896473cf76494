// Where a map lies in another one, by the walls that both show.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "host/map_server/map_store.h"
#include "shared/geometry/pose.h"

namespace ivfm::host {

struct MapMatch {
  Pose frame;         // T_team_apart of the two map frames
  double wall_m = 0;  // obstacle cells that both maps have, in metres of cells side by side
};

// Tries all headings and places: walls of either map should lie on walls of the other, and not
// where the other has seen that nothing stands. All shifts at one heading by the Fourier transforms
// of coarse grids; the best of them by all cells. Nothing is found when too little is seen by both,
// or when another place explains half as much: along a bare corridor, in a symmetric room, between
// pillars that stand alike.
class MapAlignment {
 public:
  // `team`, `apart`: copied, as they are now. `cell_um`: of both.
  MapAlignment(const MapStore& team, const MapStore& apart, std::int32_t cell_um);
  // A share of the work, some ten milliseconds in a large building; true when all is done.
  bool step();
  // After that.
  const std::optional<MapMatch>& match() const { return match_; }

 private:
  // In cells; `low` is that of the images' first pixel.
  struct View {
    std::vector<cv::Point2f> walls;  // middles of obstacle cells
    cv::Mat distance;                // float, to the nearest of them
    cv::Mat seen;                    // u8, not 0: visited
    Cell low;
  };
  struct Candidate {
    double turn = 0;     // radians, counter-clockwise
    cv::Point2d middle;  // of the apart map's walls, in the team's cells
    double score = 0;
  };
  // Obstacle cells that lie on the other map's, or where the other has seen that nothing stands.
  struct Agreement {
    int apart_hits = 0, apart_misses = 0, team_hits = 0, team_misses = 0;
    double score() const;
    bool holds() const;
    // Whether it makes the best place doubtful.
    bool rivals(const Agreement& best, double cell_m) const;
  };

  static View view_of(const MapStore& store);
  void prepare_spectra();
  cv::Mat spectrum_of(const cv::Mat& image) const;
  void try_heading();
  void note(const Candidate& candidate);
  void refine(Candidate& candidate, double reach, double least_step) const;
  double closeness(const Candidate& candidate, double reach, std::size_t stride) const;
  Agreement agreement(const Candidate& candidate) const;
  bool is_elsewhere(const Candidate& a, const Candidate& b) const;
  bool slides(const Candidate& best) const;
  void decide();
  Pose frame_of(const Candidate& candidate) const;

  std::int32_t cell_um_;
  std::int32_t block_;  // cells to a side of a coarse cell
  View team_, apart_;
  cv::Point2d middle_;  // of the apart map's walls
  double radius_ = 0;   // of them around it
  cv::Size padded_;
  cv::Mat wall_spectrum_, free_spectrum_;  // of the team's map
  int heading_ = 0;
  std::vector<Candidate> candidates_;  // the best first
  std::size_t refined_ = 0;
  std::optional<MapMatch> match_;
};

}  // namespace ivfm::host

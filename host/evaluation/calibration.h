// Compares our arena with the paper's released simulator, by what its own random policy does there.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace ivfm::host {

// One quantity, as the released simulator was measured (method.md, "Calibration") and as ours is.
struct CalibrationRow {
  std::string quantity;
  double released = 0;
  double released_error = 0;  // standard error; 0 when it was not measured
  double ours = 0;
  double ours_error = 0;

  // The difference in standard errors of the difference; 0 when the other side's is not known.
  double z() const;
};

// Plays `episodes` of the 1x arena with one robot and the policy `random-released`.
std::vector<CalibrationRow> calibrate(int episodes, std::uint64_t seed,
                                      const std::function<void(int)>& progress = {});

// A table for people.
std::string to_text(const std::vector<CalibrationRow>& rows);

}  // namespace ivfm::host

#include "host/evaluation/paper_tables.h"

namespace ivfm::host {

namespace {

using Value = PaperValue;
using Maybe = std::optional<PaperValue>;

PaperRow learned(const char* policy, Value rer, Value pe, Value steps, Maybe overlap, Value mib,
                 Value coverage, int not_found) {
  return {policy, rer, pe, steps, overlap, mib, coverage, not_found};
}

PaperRow vfm(Value rer, Value pe, Value steps, Maybe overlap, Value mib, Value coverage, int lost) {
  return learned("VFM", rer, pe, steps, overlap, mib, coverage, lost);
}

PaperRow ivfm(Value rer, Value pe, Value steps, Maybe overlap, Value mib, Value coverage,
              int lost) {
  return learned("i-VFM", rer, pe, steps, overlap, mib, coverage, lost);
}

const Maybe kNone;

PaperRow random_row() {
  return {"random", {3.083, 2.551}, {2972, 1924}, {145.5, 161.4}, kNone, kNone, {0.490, 0.327},
          3,        false};
}

PaperRow frontier_row() {
  return {"frontier",     {1.957, 2.074},
          {12469, 12792}, {44.7, 50.4},
          kNone,          Value{36, 0},
          {0.487, 0.306}, 8,
          false,          true};
}

std::vector<PaperSetting> arena_1x() {
  const char* table = "1x arena";
  return {
      {table,
       "1x",
       1,
       {random_row(), frontier_row(),
        vfm({0.488, 0.597}, {6252, 2259}, {33.9, 41.6}, {}, {4.6, 5.6}, {0.501, 0.325}, 0),
        ivfm({0.622, 0.639}, {5827, 2157}, {40.0, 43.7}, {}, {2.9, 3.1}, {0.525, 0.322}, 0)}},
      {table,
       "1x",
       2,
       {vfm({0.457, 0.426}, {6033, 2157}, {32.7, 32.2}, Value{0.1, 0.1}, {4.4, 4.3}, {0.503, 0.306},
            0),
        ivfm({0.612, 0.609}, {5607, 2301}, {39.9, 39.5}, Value{0.1, 0.1}, {2.9, 2.8},
             {0.508, 0.309}, 2)}},
      {table,
       "1x",
       4,
       {vfm({0.387, 0.306}, {5930, 2481}, {30.8, 24.4}, Value{0.1, 0.1}, {4.2, 3.3}, {0.478, 0.305},
            0),
        ivfm({0.484, 0.480}, {6086, 2468}, {36.3, 34.5}, Value{0.1, 0.1}, {2.6, 2.5},
             {0.467, 0.309}, 0)}},
  };
}

std::vector<PaperSetting> divider() {
  const char* table = "Divider";
  return {
      {table,
       "divider",
       1,
       {vfm({0.492, 0.517}, {5914, 2250}, {31.8, 34.3}, {}, {4.3, 4.6}, {0.480, 0.308}, 6),
        ivfm({0.584, 0.424}, {5524, 2305}, {33.6, 30.0}, {}, {2.4, 2.1}, {0.460, 0.302}, 5)}},
      {table,
       "divider",
       2,
       {vfm({0.477, 0.473}, {5601, 2353}, {32.3, 33.0}, Value{0.1, 0.1}, {4.4, 4.4}, {0.466, 0.316},
            0),
        ivfm({0.577, 0.529}, {5529, 2376}, {32.7, 30.8}, Value{0.1, 0.1}, {2.4, 2.2},
             {0.443, 0.293}, 1)}},
      {table,
       "divider",
       4,
       {vfm({0.502, 0.496}, {5574, 2626}, {35.5, 35.6}, Value{0.2, 0.1}, {4.8, 4.7}, {0.473, 0.319},
            0),
        ivfm({0.602, 0.651}, {5664, 2519}, {39.3, 41.8}, Value{0.2, 0.2}, {2.8, 3.0},
             {0.472, 0.289}, 0)}},
  };
}

std::vector<PaperSetting> arena_2x() {
  const char* table = "2x arena";
  const Maybe tenth = Value{0.1, 0.1};
  return {
      {table,
       "2x",
       1,
       {vfm({0.484, 0.471}, {6136, 1961}, {59.3, 62.9}, {}, {8.1, 8.5}, {0.477, 0.315}, 1),
        ivfm({0.575, 0.427}, {5957, 1696}, {66.5, 59.5}, {}, {4.8, 4.3}, {0.485, 0.287}, 1)}},
      {table,
       "2x",
       2,
       {vfm({0.507, 0.522}, {6206, 1909}, {62.4, 67.9}, tenth, {8.5, 9.1}, {0.473, 0.319}, 1),
        ivfm({0.550, 0.409}, {5735, 2084}, {66.8, 58.6}, tenth, {4.8, 4.2}, {0.477, 0.310}, 1)}},
      {table,
       "2x",
       3,
       {vfm({0.422, 0.401}, {5995, 2223}, {54.4, 54.2}, tenth, {7.4, 7.3}, {0.444, 0.297}, 1),
        ivfm({0.494, 0.370}, {6072, 2062}, {61.8, 52.8}, tenth, {4.5, 3.8}, {0.452, 0.293}, 0)}},
      {table,
       "2x",
       4,
       {vfm({0.419, 0.343}, {6230, 2078}, {54.8, 49.6}, tenth, {7.5, 6.7}, {0.453, 0.306}, 1),
        ivfm({0.491, 0.366}, {6083, 1992}, {61.9, 51.1}, tenth, {4.5, 3.7}, {0.461, 0.290}, 3)}},
      {table,
       "2x",
       5,
       {vfm({0.375, 0.303}, {6867, 1804}, {49.9, 44.9}, tenth, {6.8, 6.1}, {0.440, 0.290}, 3),
        ivfm({0.420, 0.354}, {6421, 2188}, {56.1, 51.5}, tenth, {4.1, 3.7}, {0.406, 0.292}, 3)}},
  };
}

// Two TurtleBots with an RPLIDAR A1 until half was explored; the paper does not say which policy's
// state, nor how many runs.
std::vector<PaperSetting> corridor() {
  PaperRow row{"real robots", {0.626, 0.135}, {4533, 410},    {42.5, 26.2},
               kNone,         kNone,          {0.514, 0.008}, {}};
  return {{"Real corridor", "corridor", 2, {row}}};
}

std::vector<PaperSetting> all_settings() {
  std::vector<PaperSetting> all;
  for (const auto& table : {arena_1x(), divider(), arena_2x(), corridor()}) {
    all.insert(all.end(), table.begin(), table.end());
  }
  return all;
}

}  // namespace

std::span<const PaperSetting> paper_settings() {
  static const std::vector<PaperSetting> settings = all_settings();
  return settings;
}

}  // namespace ivfm::host

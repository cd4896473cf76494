#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "shared/geometry/binary_angle.h"
#include "shared/geometry/grid_frame.h"
#include "shared/geometry/pose.h"

namespace ivfm {
namespace {

TEST(BinaryAngle, WrapsAndConverts) {
  EXPECT_EQ(BinaryAngle::from_degrees(90).raw(), 0x4000);
  EXPECT_EQ(BinaryAngle::from_degrees(-90).raw(), 0xc000);
  EXPECT_EQ(BinaryAngle::from_degrees(270), BinaryAngle::from_degrees(-90));
  EXPECT_EQ((BinaryAngle(0xfff0) + BinaryAngle(0x0020)).raw(), 0x0010);
  EXPECT_NEAR(BinaryAngle::from_radians(1.0).radians(), 1.0, 1e-4);
}

TEST(BinaryAngle, SineAndCosineMatchTheLibraryAtEveryAngle) {
  for (int raw = 0; raw < 65536; ++raw) {
    const BinaryAngle a(static_cast<std::uint16_t>(raw));
    const double exact = raw * std::numbers::pi / 32768.0;
    ASSERT_NEAR(sin_q30(a) / 1073741824.0, std::sin(exact), 1.3e-6) << raw;
    ASSERT_NEAR(cos_q30(a) / 1073741824.0, std::cos(exact), 1.3e-6) << raw;
  }
}

TEST(BinaryAngle, ArctangentMatchesTheLibraryInEveryDirection) {
  for (int raw = 0; raw < 65536; raw += 7) {
    const double exact = raw * std::numbers::pi / 32768.0;
    for (const double radius : {300.0, 1e4, 2e9}) {
      const auto x = std::llround(radius * std::cos(exact)),
                 y = std::llround(radius * std::sin(exact));
      const double want = std::atan2(static_cast<double>(y), static_cast<double>(x));
      const double off = (atan2_binary(y, x) - BinaryAngle::from_radians(want)).signed_raw();
      ASSERT_LE(std::abs(off), 2.0) << raw << " at " << radius;
    }
  }
  EXPECT_EQ(atan2_binary(0, 0).raw(), 0);
}

TEST(Pose, TransformTurnsLeftIntoPlusYWhenFacingPlusX) {
  const Pose facing_north{{1'000'000, 2'000'000}, BinaryAngle::from_degrees(90)};
  EXPECT_EQ(transform(facing_north, 500'000, 0), (Point{1'000'000, 2'500'000}));
  EXPECT_EQ(transform(facing_north, 0, 500'000), (Point{500'000, 2'000'000}));
}

TEST(GridFrame, NegativeCoordinatesRoundDown) {
  const GridFrame frame(50'000, {-10, -10, 20, 20});
  EXPECT_EQ(frame.cell_at({0, 0}), (Cell{0, 0}));
  EXPECT_EQ(frame.cell_at({-1, 49'999}), (Cell{-1, 0}));
  EXPECT_EQ(frame.cell_at({-50'000, -50'001}), (Cell{-1, -2}));
  EXPECT_EQ(frame.cell_at(frame.center_of({-7, 3})), (Cell{-7, 3}));
}

TEST(GridFrame, IndicesRunRowByRowFromTheLowestRow) {
  const GridFrame frame(50'000, {-2, 5, 4, 3});
  EXPECT_EQ(frame.size(), 12u);
  EXPECT_EQ(frame.index_of({-2, 5}), 0u);
  EXPECT_EQ(frame.index_of({1, 7}), 11u);
  for (std::size_t i = 0; i < frame.size(); ++i)
    EXPECT_EQ(frame.index_of(frame.cell_of_index(i)), i);
}

TEST(CellRect, IntersectsAndUnites) {
  const CellRect a{0, 0, 4, 4}, b{2, 3, 5, 5};
  EXPECT_EQ(a.intersection(b), (CellRect{2, 3, 2, 1}));
  EXPECT_EQ(a.united(b), (CellRect{0, 0, 7, 8}));
  EXPECT_TRUE(a.intersection({4, 0, 1, 1}).empty());
  EXPECT_EQ(CellRect{}.united(Cell{-3, 9}), (CellRect{-3, 9, 1, 1}));
}

}  // namespace
}  // namespace ivfm

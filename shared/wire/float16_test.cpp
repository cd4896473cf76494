#include "shared/wire/float16.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace ivfm {
namespace {

// The value of a finite binary16 by the definition in IEEE 754-2008, section 3.4.
double defined_value(Float16 bits) {
  const int field = (bits >> 10) & 31, fraction = bits & 1023;
  const double magnitude =
      field == 0 ? std::ldexp(fraction, -24) : std::ldexp(1024 + fraction, field - 25);
  return bits & 0x8000 ? -magnitude : magnitude;
}

bool finite(unsigned bits) { return (bits & 0x7c00u) != 0x7c00u; }

TEST(Float16, KnownValuesHaveTheirStandardBits) {
  EXPECT_EQ(float16_from_float(0.0f), 0x0000);
  EXPECT_EQ(float16_from_float(-0.0f), 0x8000);
  EXPECT_EQ(float16_from_float(1.0f), 0x3c00);
  EXPECT_EQ(float16_from_float(-2.0f), 0xc000);
  EXPECT_EQ(float16_from_float(65504.0f), 0x7bff);
  EXPECT_EQ(float16_from_float(0.333251953125f), 0x3555);
  EXPECT_EQ(float16_from_float(5.9604644775390625e-8f), 0x0001);
  EXPECT_EQ(float16_from_float(6.103515625e-5f), 0x0400);
  EXPECT_EQ(float16_from_float(std::numeric_limits<float>::infinity()), 0x7c00);
  EXPECT_EQ(float16_from_float(-1e9f), 0xfc00);
  EXPECT_EQ(float16_from_float(std::numeric_limits<float>::quiet_NaN()) & 0x7fff, 0x7e00);
}

TEST(Float16, AllBitPatternsSurviveTheWayThroughFloat) {
  for (unsigned bits = 0; bits < 65536; ++bits) {
    const auto half = static_cast<Float16>(bits);
    const float value = float_from_float16(half);
    if (finite(bits)) {
      ASSERT_EQ(static_cast<double>(value), defined_value(half)) << bits;
      ASSERT_EQ(std::signbit(value), (bits & 0x8000u) != 0) << bits;
      ASSERT_EQ(float16_from_float(value), half) << bits;
    } else if ((bits & 0x3ffu) == 0) {
      ASSERT_TRUE(std::isinf(value)) << bits;
      ASSERT_EQ(float16_from_float(value), half) << bits;
    } else {
      ASSERT_TRUE(std::isnan(value)) << bits;
      ASSERT_EQ(float16_from_float(value) & 0x7fff, 0x7e00) << bits;
    }
  }
}

TEST(Float16, FloatsHalfWayBetweenTwoValuesGoToTheEvenOne) {
  for (unsigned bits = 0; bits < 0x7bff; ++bits) {
    const double low = defined_value(static_cast<Float16>(bits));
    const double high = defined_value(static_cast<Float16>(bits + 1));
    const auto middle = static_cast<float>((low + high) / 2);
    const unsigned even = bits % 2 == 0 ? bits : bits + 1;
    ASSERT_EQ(float16_from_float(middle), even);
    ASSERT_EQ(float16_from_float(std::nextafter(middle, 0.0f)), bits);
    ASSERT_EQ(float16_from_float(std::nextafter(middle, 1e9f)), bits + 1);
    ASSERT_EQ(float16_from_float(-middle), even | 0x8000u);
  }
  EXPECT_EQ(float16_from_float(65519.996f), 0x7bff);
  EXPECT_EQ(float16_from_float(65520.0f), 0x7c00);
}

// The nearest binary16, found by comparing with both neighbours of the candidate.
void expect_nearest(Float16 got, double exact) {
  ASSERT_TRUE(finite(got));
  const double error = std::abs(defined_value(got) - exact);
  for (int step : {-1, 1}) {
    const int other = (got & 0x7fff) + step;
    if (other < 0 || !finite(static_cast<unsigned>(other))) continue;
    const auto neighbour = static_cast<Float16>(other | (got & 0x8000));
    const double other_error = std::abs(defined_value(neighbour) - exact);
    ASSERT_LE(error, other_error) << exact;
    if (error == other_error) {
      ASSERT_EQ(got % 2, 0) << exact;
    }
  }
}

TEST(Float16, MicrometresGoToTheNearestValue) {
  EXPECT_EQ(float16_from_um(0), 0x0000);
  EXPECT_EQ(float16_from_um(1000000), 0x3c00);
  EXPECT_EQ(float16_from_um(-1500000), 0xbe00);
  EXPECT_EQ(float16_from_um(std::numeric_limits<std::int32_t>::min()), 0xe832);  // -2148 m
  for (std::int64_t um = 1; um < 2147483647; um = um * 17 / 16 + 1) {
    expect_nearest(float16_from_um(static_cast<std::int32_t>(um)), static_cast<double>(um) * 1e-6);
    expect_nearest(float16_from_um(static_cast<std::int32_t>(-um)),
                   -static_cast<double>(um) * 1e-6);
  }
}

TEST(Float16, AllBitPatternsGiveTheRightMicrometresOrARefusal) {
  for (unsigned bits = 0; bits < 65536; ++bits) {
    const auto result = um_from_float16(static_cast<Float16>(bits));
    const double um = finite(bits) ? defined_value(static_cast<Float16>(bits)) * 1e6 : 1e99;
    if (std::abs(um) < 2147483647.0) {
      ASSERT_TRUE(result.ok()) << bits;
      ASSERT_EQ(*result, std::llround(um)) << bits;
    } else {
      ASSERT_EQ(result.status(), Status::kOutOfRange) << bits;
    }
  }
}

TEST(Float16, AllBinaryAnglesGoToTheNearestRadians) {
  for (unsigned raw = 0; raw < 65536; ++raw) {
    const BinaryAngle angle(static_cast<std::uint16_t>(raw));
    expect_nearest(float16_from_angle(angle), angle.signed_raw() * (M_PI / 32768.0));
  }
}

TEST(Float16, AllBitPatternsGiveTheRightAngleOrARefusal) {
  for (unsigned bits = 0; bits < 65536; ++bits) {
    const auto result = angle_from_float16(static_cast<Float16>(bits));
    const double radians = finite(bits) ? defined_value(static_cast<Float16>(bits)) : 1e99;
    if (std::abs(radians) < 8.0) {
      ASSERT_TRUE(result.ok()) << bits;
      const auto expected = static_cast<unsigned long>(std::llround(radians * 32768.0 / M_PI));
      ASSERT_EQ(result->raw(), expected & 0xffffu) << bits;
    } else {
      ASSERT_EQ(result.status(), Status::kOutOfRange) << bits;
    }
  }
}

TEST(Float16, APoseKeepsItsPlaceToAMillimetreAndItsHeadingToAMilliradian) {
  const Pose pose{{1234567, -987654}, BinaryAngle::from_degrees(135)};
  const auto back = unpack_pose(pack_pose(pose));
  ASSERT_TRUE(back.ok());
  EXPECT_NEAR(back->position.x_um, pose.position.x_um, 500);
  EXPECT_NEAR(back->position.y_um, pose.position.y_um, 500);
  EXPECT_NEAR(back->heading.radians(), pose.heading.radians(), 0.001);
  EXPECT_EQ(unpack_pose({0x7c00, 0, 0}).status(), Status::kOutOfRange);
  EXPECT_EQ(unpack_pose({0, 0, 0x7e00}).status(), Status::kOutOfRange);
}

}  // namespace
}  // namespace ivfm

#include <gtest/gtest.h>
#include <stillmap/maps/fast_angle.hpp>

#include <cmath>
#include <numbers>

namespace stillmap::maps {
namespace fast_angle_test {

TEST(FastAngle, IsThatOfTheLibraryWithinItsBound) {
  for (int i = -10'000; i <= 10'000; ++i) {
    const double angle_rad = i * std::numbers::pi / 10'000;
    for (const double r : {0.01, 1.0, 80.0}) {
      const auto y = static_cast<float>(r * std::sin(angle_rad));
      const auto x = static_cast<float>(r * std::cos(angle_rad));
      const double off_rad =
          std::remainder(fast_angle(y, x) - std::atan2(y, x), 2.0 * std::numbers::pi);
      ASSERT_LT(std::abs(off_rad), 2e-5) << y << ", " << x;
    }
  }
}

TEST(FastAngle, OfTheOriginIsZero) { EXPECT_EQ(fast_angle(0.0F, 0.0F), 0.0F); }

}  // namespace fast_angle_test
}  // namespace stillmap::maps

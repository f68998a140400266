#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

namespace stillmap::maps {

/// atan2 within 2e-5 rad, several times as fast as the library's, and the same bits everywhere. 0
/// for the origin.
/// @see Hastings, "Approximations for Digital Computers", 1955, sheet 11 (odd polynomial).
[[nodiscard]] inline float fast_angle(float y, float x) {
  const float ax = std::abs(x), ay = std::abs(y);
  const float larger = std::max(ax, ay);
  if (!(larger > 0.0F)) return 0.0F;
  const float t = std::min(ax, ay) / larger;
  const float s = t * t;
  float a =
      t * (0.99997726F +
           s * (-0.33262347F +
                s * (0.19354346F + s * (-0.11643287F + s * (0.05265332F - s * 0.01172120F)))));
  if (ay > ax) a = 0.5F * std::numbers::pi_v<float> - a;
  if (x < 0.0F) a = std::numbers::pi_v<float> - a;
  return y < 0.0F ? -a : a;
}

}  // namespace stillmap::maps

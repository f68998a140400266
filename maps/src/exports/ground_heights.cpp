#include "exports/ground_heights.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace stillmap::maps {
namespace {

constexpr int kCarriedOnM = 5;
constexpr float kNoHeight = std::numeric_limits<float>::quiet_NaN();

}  // namespace

GroundHeights::GroundHeights(const Eigen::Vector2d& min, const Eigen::Vector2d& max)
    : min_(min.array().floor()),
      width_(static_cast<std::size_t>(std::floor(max.x()) - min_.x()) + 1),
      height_(static_cast<std::size_t>(std::floor(max.y()) - min_.y()) + 1),
      heights_m_(width_ * height_, 0.0F),
      counts_(width_ * height_, 0) {}

void GroundHeights::add(const Eigen::Vector3d& ground_point) {
  const std::size_t square = square_at(ground_point.x(), ground_point.y());
  if (square >= counts_.size()) return;
  // A running mean: sums of floats grow coarse.
  ++counts_[square];
  heights_m_[square] += (static_cast<float>(ground_point.z()) - heights_m_[square]) /
                        static_cast<float>(counts_[square]);
}

bool GroundHeights::finish() {
  bool any = false;
  for (std::size_t i = 0; i < heights_m_.size(); ++i) {
    any |= counts_[i] > 0;
    if (counts_[i] == 0) heights_m_[i] = kNoHeight;
  }
  counts_ = {};
  for (int step = 0; step < kCarriedOnM; ++step) grow();
  return any;
}

/// Squares without a height get the mean of those beside them.
void GroundHeights::grow() {
  const std::vector<float> before = heights_m_;
  for (std::size_t y = 0; y < height_; ++y) {
    for (std::size_t x = 0; x < width_; ++x) {
      if (!std::isnan(before[y * width_ + x])) continue;
      float sum = 0.0F;
      int count = 0;
      const auto take = [&](std::size_t square) {
        if (std::isnan(before[square])) return;
        sum += before[square];
        ++count;
      };
      if (x > 0) take(y * width_ + x - 1);
      if (x + 1 < width_) take(y * width_ + x + 1);
      if (y > 0) take((y - 1) * width_ + x);
      if (y + 1 < height_) take((y + 1) * width_ + x);
      if (count > 0) heights_m_[y * width_ + x] = sum / static_cast<float>(count);
    }
  }
}

std::size_t GroundHeights::square_at(double x, double y) const {
  const double column = x - min_.x();
  const double row = y - min_.y();
  if (!(column >= 0.0 && row >= 0.0 && column < static_cast<double>(width_) &&
        row < static_cast<double>(height_)))
    return width_ * height_;
  return static_cast<std::size_t>(row) * width_ + static_cast<std::size_t>(column);
}

float GroundHeights::at(double x, double y) const {
  const std::size_t square = square_at(x, y);
  return square < heights_m_.size() ? heights_m_[square] : kNoHeight;
}

}  // namespace stillmap::maps

#include "reference/range_image.hpp"

#include <stillmap/maps/median.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr float kImagePi = std::numbers::pi_v<float>;
/// Pixels in a segment of a row.
constexpr int kSegment = 8;

}  // namespace

RangeImage::RangeImage(const std::vector<Spherical>& scan, double pixel_rad) {
  if (!(pixel_rad > 0.0 && pixel_rad <= 0.25 * std::numbers::pi)) {
    throw std::invalid_argument("pixel_rad: " + std::to_string(pixel_rad) +
                                ", must be in (0, pi/4]");
  }
  columns_ = static_cast<int>(std::lround(2.0 * std::numbers::pi / pixel_rad));
  columns_per_rad_ = static_cast<float>(columns_) / (2.0F * kImagePi);
  rows_per_rad_ = static_cast<float>(1.0 / pixel_rad);
  if (scan.empty()) return;
  const auto [low, high] = std::minmax_element(
      scan.begin(), scan.end(),
      [](const Spherical& a, const Spherical& b) { return a.elevation_rad < b.elevation_rad; });
  first_row_ = row_of(low->elevation_rad);
  rows_ = row_of(high->elevation_rad) - first_row_ + 1;
  nearest_m_.assign(static_cast<std::size_t>(rows_) * static_cast<std::size_t>(columns_), 0.0F);
  for (const Spherical& point : scan) {
    float& nearest = nearest_m_[static_cast<std::size_t>(pixel_of(point))];
    if (nearest == 0.0F || point.range_m < nearest) nearest = point.range_m;
  }
  bound_segments();
}

int RangeImage::row_of(float elevation_rad) const {
  return static_cast<int>((elevation_rad + 0.5F * kImagePi) * rows_per_rad_);
}

int RangeImage::column_of(float azimuth_rad) const {
  return std::min(static_cast<int>((azimuth_rad + kImagePi) * columns_per_rad_), columns_ - 1);
}

int RangeImage::pixel_of(const Spherical& direction) const {
  const int row = row_of(direction.elevation_rad) - first_row_;
  if (row < 0 || row >= rows_) return -1;
  return row * columns_ + column_of(direction.azimuth_rad);
}

void RangeImage::bound_segments() {
  segments_ = (columns_ + kSegment - 1) / kSegment;
  segment_max_m_.assign(static_cast<std::size_t>(segments_ * rows_), 0.0F);
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      const float value = nearest_m_[static_cast<std::size_t>(row * columns_ + column)];
      float& largest =
          segment_max_m_[static_cast<std::size_t>(row * segments_ + column / kSegment)];
      largest = std::max(largest, value);
      max_m_ = std::max(max_m_, value);
    }
  }
}

float RangeImage::largest_in(int row_begin, int row_last, int column_begin, int column_last) const {
  float largest = 0.0F;
  for (int column = column_begin; column <= column_last;) {
    const int wrapped = (column % columns_ + columns_) % columns_;
    for (int row = row_begin; row <= row_last; ++row) {
      const auto segment = static_cast<std::size_t>(row * segments_ + wrapped / kSegment);
      largest = std::max(largest, segment_max_m_[segment]);
    }
    // To the next segment; the last one of a row may be cut.
    column += std::min(kSegment - wrapped % kSegment, columns_ - wrapped);
  }
  return largest;
}

float RangeImage::farthest_behind(const Eigen::Vector3f& centre,
                                  const Eigen::Vector3f& half_edge) const {
  const float flat_m = centre.head<2>().norm();
  const float radius_m = half_edge.head<2>().norm();
  // asin(q) <= 1.05 q up to q = 0.5; nearer boxes are not worth a window.
  if (flat_m < 2.0F * radius_m) return max_m_;
  const float near_m = (centre.head<2>().cwiseAbs() - half_edge.head<2>()).cwiseMax(0.0F).norm();
  const float far_m = (centre.head<2>().cwiseAbs() + half_edge.head<2>()).norm();
  const float low_m = centre.z() - half_edge.z();
  const float high_m = centre.z() + half_edge.z();
  // A height looks steepest where it is nearest.
  const float lowest = spherical_of({low_m > 0.0F ? far_m : near_m, 0.0F, low_m}).elevation_rad;
  const float highest = spherical_of({high_m > 0.0F ? near_m : far_m, 0.0F, high_m}).elevation_rad;
  // A little wider than it need be is cheaper than being exact about rounding.
  constexpr float kRoundingRad = 1e-4F;
  const int row_begin = row_of(lowest - kRoundingRad) - first_row_;
  const int row_last = row_of(highest + kRoundingRad) - first_row_;
  if (row_last < 0 || row_begin >= rows_) return 0.0F;
  const float middle = spherical_of({centre.x(), centre.y(), 0.0F}).azimuth_rad + kImagePi;
  const float half_rad = 1.05F * radius_m / flat_m + kRoundingRad;
  return largest_in(std::max(row_begin, 0), std::min(row_last, rows_ - 1),
                    static_cast<int>(std::floor((middle - half_rad) * columns_per_rad_)),
                    static_cast<int>(std::floor((middle + half_rad) * columns_per_rad_)));
}

double ring_spacing_rad(const std::vector<Spherical>& scan) {
  constexpr double kDefault = 0.4 * std::numbers::pi / 180.0;
  // Wide enough that every ring has a shot in it; nearer together is noise of one ring.
  constexpr float kColumnRad = 0.4F * kImagePi / 180.0F;
  constexpr float kSameRingRad = 0.05F * kImagePi / 180.0F;
  // A gap in what is seen, not between rings.
  constexpr float kFarRad = 5.0F * kImagePi / 180.0F;
  constexpr std::size_t kFewestGaps = 100;
  std::vector<std::pair<int, float>> points;
  points.reserve(scan.size());
  for (const Spherical& point : scan) {
    points.emplace_back(static_cast<int>((point.azimuth_rad + kImagePi) / kColumnRad),
                        point.elevation_rad);
  }
  std::sort(points.begin(), points.end());
  std::vector<float> gaps;
  for (std::size_t i = 1; i < points.size(); ++i) {
    if (points[i].first != points[i - 1].first) continue;
    const float gap = points[i].second - points[i - 1].second;
    if (gap > kSameRingRad && gap < kFarRad) gaps.push_back(gap);
  }
  if (gaps.size() < kFewestGaps) return kDefault;
  return static_cast<double>(maps::median(std::move(gaps)));
}

}  // namespace stillmap::mapping

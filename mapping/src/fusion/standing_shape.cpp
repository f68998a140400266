#include "fusion/standing_shape.hpp"

#include <stillmap/maps/cell_table.hpp>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace stillmap::mapping {
namespace {

constexpr double kGrownM = 0.2;
constexpr double kColumnM = 0.3;
constexpr double kRingFromM = 0.3, kRingToM = 0.9;
constexpr double kBodyFromM = 0.3, kBodyToM = 1.5;

/// What stands in one column of the footprint.
struct Column {
  bool low = false, skirt = false, high = false;
};

/// Collects what a shape is made of, in the frame of the box.
class Gathering {
 public:
  explicit Gathering(const Eigen::Vector2d& half) : half_(half) {
    for (int side = 0; side < 4; ++side) {
      const double length = 2.0 * (side < 2 ? half.x() : half.y());
      sides_[side].assign(static_cast<std::size_t>(std::ceil(length / kColumnM)) + 1, false);
    }
  }

  /// @param p  along the length and across [m] from the centre, then the height over the ground.
  void add(const Eigen::Vector3d& p, const Obstacle& obstacle) {
    const Eigen::Vector2d out = p.head<2>().cwiseAbs() - half_;
    const double outside = out.maxCoeff();
    if (outside > kRingFromM && outside <= kRingToM && p.z() > kBodyFromM && p.z() < kBodyToM)
      ++ring_;
    if (outside > kGrownM) return;
    heights_.push_back(p.z());
    planarity_ += obstacle.planarity / 255.0;
    scans_ += obstacle.scans;
    Column& column = columns_[maps::plane_cell_key(static_cast<int>(std::floor(p.x() / kColumnM)),
                                                   static_cast<int>(std::floor(p.y() / kColumnM)))];
    column.low |= p.z() < 1.8;
    column.skirt |= p.z() < 0.3;
    column.high |= p.z() > 2.3;
    if (p.z() > kBodyFromM && p.z() < kBodyToM) ++body_;
    if (p.z() < 1.0 && p.z() > kBodyFromM) {
      ++low_;
      inside_ += outside < -0.4 ? 1 : 0;
      mark_sides(p, out);
    }
  }

  [[nodiscard]] StandingShape shape() {
    StandingShape shape;
    shape.voxels = heights_.size();
    if (heights_.empty()) return shape;
    const auto count = static_cast<double>(heights_.size());
    const auto top = heights_.begin() + static_cast<std::ptrdiff_t>(0.95 * count);
    std::nth_element(heights_.begin(), top, heights_.end());
    shape.top_m = *top;
    shape.planarity = planarity_ / count;
    shape.scans = scans_ / count;
    shape.inside_share = low_ == 0 ? 0.0 : static_cast<double>(inside_) / low_;
    shape.ring_ratio = static_cast<double>(ring_) / std::max(1, body_);
    double tall = 0.0, skirt = 0.0;
    for (const auto& [place, column] : columns_) {
      tall += column.low && column.high ? 1.0 : 0.0;
      skirt += column.skirt ? 1.0 : 0.0;
    }
    const auto columns = static_cast<double>(columns_.size());
    shape.tall_share = tall / columns;
    shape.skirt_share = skirt / columns;
    shape.covered_share = columns / ((2.0 * (half_.x() + kGrownM) / kColumnM) *
                                     (2.0 * (half_.y() + kGrownM) / kColumnM));
    double outline = 0.0;
    for (const std::vector<bool>& side : sides_)
      outline += static_cast<double>(std::count(side.begin(), side.end(), true)) /
                 static_cast<double>(side.size());
    shape.outline_share = outline / 4.0;
    return shape;
  }

 private:
  void mark_sides(const Eigen::Vector3d& p, const Eigen::Vector2d& out) {
    const auto mark = [](std::vector<bool>& side, double at) {
      const auto i = static_cast<std::ptrdiff_t>(at / kColumnM);
      if (i >= 0 && i < static_cast<std::ptrdiff_t>(side.size()))
        side[static_cast<std::size_t>(i)] = true;
    };
    if (std::abs(out.y()) < kColumnM) mark(sides_[p.y() > 0.0 ? 0 : 1], p.x() + half_.x());
    if (std::abs(out.x()) < kColumnM) mark(sides_[p.x() > 0.0 ? 2 : 3], p.y() + half_.y());
  }

  Eigen::Vector2d half_;
  std::vector<double> heights_;
  double planarity_ = 0.0, scans_ = 0.0;
  int ring_ = 0, body_ = 0, low_ = 0, inside_ = 0;
  maps::CellMap<Column> columns_;
  std::vector<bool> sides_[4];
};

}  // namespace

double reach_of_shape_m(const maps::Box& box) {
  return 0.5 * box.size_m.head<2>().norm() + 1.5 * kRingToM;
}

StandingShape shape_of(const ObstacleMap& obstacles, const maps::Box& box) {
  const Eigen::Vector2d half = 0.5 * box.size_m.head<2>();
  const Eigen::Vector2d heading(std::cos(box.yaw_rad), std::sin(box.yaw_rad));
  Gathering gathering(half);
  for (const Obstacle* each : obstacles.around(box.centre.head<2>(), reach_of_shape_m(box))) {
    const Eigen::Vector3d p = each->position.cast<double>();
    const Eigen::Vector2d d = p.head<2>() - box.centre.head<2>();
    gathering.add({heading.dot(d), heading.x() * d.y() - heading.y() * d.x(), p.z()}, *each);
  }
  return gathering.shape();
}

}  // namespace stillmap::mapping

#include "exports/occupancy_grid.hpp"

#include <cmath>

namespace stillmap::maps {
namespace {

/// No sensor sees farther.
constexpr double kLongestRayM = 500.0;

Eigen::Vector2d floored(const Eigen::Vector2d& p, double resolution_m) {
  return (p / resolution_m).array().floor() * resolution_m;
}

Eigen::Vector2d counted(const Eigen::Vector2d& min, const Eigen::Vector2d& max,
                        double resolution_m) {
  return ((max - floored(min, resolution_m)) / resolution_m).array().floor() + 1.0;
}

}  // namespace

OccupancyGrid::OccupancyGrid(const Eigen::Vector2d& min, const Eigen::Vector2d& max,
                             double resolution_m, const std::array<double, 2>& height_band_m,
                             const GroundHeights& ground)
    : resolution_m_(resolution_m),
      band_m_(height_band_m),
      ground_(&ground),
      min_(floored(min, resolution_m)),
      width_(static_cast<std::size_t>(counted(min, max, resolution_m).x())),
      height_(static_cast<std::size_t>(counted(min, max, resolution_m).y())),
      cells_(width_ * height_, Cell::kUnknown) {}

double OccupancyGrid::cells(const Eigen::Vector2d& min, const Eigen::Vector2d& max,
                            double resolution_m) {
  return counted(min, max, resolution_m).prod();
}

Cell* OccupancyGrid::find(double x, double y) {
  const double column = (x - min_.x()) / resolution_m_;
  const double row = (y - min_.y()) / resolution_m_;
  if (!(column >= 0.0 && row >= 0.0 && column < static_cast<double>(width_) &&
        row < static_cast<double>(height_)))
    return nullptr;
  return &cells_[static_cast<std::size_t>(row) * width_ + static_cast<std::size_t>(column)];
}

void OccupancyGrid::add_point(const Eigen::Vector3d& p, bool is_ground) {
  Cell* cell = find(p.x(), p.y());
  if (cell == nullptr) return;
  if (is_ground) {
    if (*cell == Cell::kUnknown) *cell = Cell::kFree;
    return;
  }
  const double above_m = p.z() - static_cast<double>(ground_->at(p.x(), p.y()));
  // Without a ground nobody knows how high it is.
  if (above_m >= band_m_[0] && above_m <= band_m_[1]) *cell = Cell::kOccupied;
}

void OccupancyGrid::add_ray(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  const Eigen::Vector3d way = to - from;
  const double length_m = way.head<2>().norm();
  if (!(length_m <= kLongestRayM)) return;
  // A cell a step: a corner that is missed is seen by another ray.
  const auto steps = static_cast<std::int64_t>(length_m / resolution_m_);
  const Cell* last = find(to.x(), to.y());
  for (std::int64_t i = 0; i < steps; ++i) {
    const Eigen::Vector3d p = from + way * (static_cast<double>(i) / static_cast<double>(steps));
    Cell* cell = find(p.x(), p.y());
    if (cell == nullptr || *cell != Cell::kUnknown || cell == last) continue;
    const double above_m = p.z() - static_cast<double>(ground_->at(p.x(), p.y()));
    if (above_m >= band_m_[0] && above_m <= band_m_[1]) *cell = Cell::kFree;
  }
}

}  // namespace stillmap::maps

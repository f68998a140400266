#include "evaluation/labels/footprints.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Poses that differ by less are the same [m or rad]: what is written with 9 decimals.
constexpr double kSamePose = 1e-6;
constexpr double kFootprintCellM = 0.25;
constexpr double kSameHeightM = 0.05;
constexpr double kStepM = 0.08;
constexpr double kSampleM = 0.1;
/// Edge of the cells that footprints are found in [m], and the most that they may be grown.
constexpr double kIndexCellM = 4.0;
constexpr double kMostMarginM = 0.5;
/// Ends of the bands of distance from the path [m].
constexpr std::array<double, 4> kDistancesM{10.0, 25.0, 50.0,
                                            std::numeric_limits<double>::infinity()};
/// What a cell met.
constexpr std::uint8_t kProjectedBit = 1;
constexpr std::uint8_t kFilledBit = 2;
constexpr std::uint8_t kWrongBit = 4;
/// No object is longer [m]; what claims to be is a broken file.
constexpr double kMostSizeM = 200.0;

std::int64_t cell_along(double x, double edge) {
  return static_cast<std::int64_t>(std::floor(x / edge));
}

/// Half the sides of the upright rectangle around a footprint [m].
Eigen::Vector2d reach_of(const Footprint& footprint) {
  const Eigen::Vector2d h = footprint.heading.cwiseAbs();
  return {h.x() * footprint.half_length + h.y() * footprint.half_width,
          h.y() * footprint.half_length + h.x() * footprint.half_width};
}

template <typename Visit>
void for_each_cell(const Footprint& footprint, double margin_m, double edge, const Visit& visit) {
  const Eigen::Vector2d reach = reach_of(footprint).array() + margin_m;
  const Eigen::Vector2d low = footprint.centre - reach;
  const Eigen::Vector2d high = footprint.centre + reach;
  for (std::int64_t x = cell_along(low.x(), edge); x <= cell_along(high.x(), edge); ++x) {
    for (std::int64_t y = cell_along(low.y(), edge); y <= cell_along(high.y(), edge); ++y)
      visit(x, y);
  }
}

}  // namespace

TrueHeights::TrueHeights(const DriveTruth& truth, const Eigen::Vector3d& origin,
                         std::vector<Eigen::Vector3f> path,
                         std::vector<Eigen::Isometry3d> T_truth_map)
    : truth_(truth), origin_(origin), path_(std::move(path)), T_truth_map_(std::move(T_truth_map)) {
  if (path_.empty() || path_.size() != T_truth_map_.size())
    throw std::invalid_argument("true heights: expected a transform for each place of a path");
  for (const Eigen::Isometry3d& T : T_truth_map_) {
    const Eigen::Isometry3d difference = T_truth_map_.front().inverse() * T;
    same_everywhere_ = same_everywhere_ && difference.translation().norm() < kSamePose &&
                       (difference.linear() - Eigen::Matrix3d::Identity()).norm() < kSamePose;
  }
}

std::size_t TrueHeights::nearest_place(const Eigen::Vector3d& p) const {
  std::size_t nearest = 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < path_.size(); ++i) {
    const double squared = (path_[i].head<2>().cast<double>() - p.head<2>()).squaredNorm();
    if (!(squared < least)) continue;
    least = squared;
    nearest = i;
  }
  return nearest;
}

double TrueHeights::path_distance(const Eigen::Vector3d& p) const {
  return (path_[nearest_place(p)].head<2>().cast<double>() - p.head<2>()).norm();
}

std::optional<double> TrueHeights::over_surface(const Eigen::Vector3d& p) const {
  const std::size_t place = same_everywhere_ ? 0 : nearest_place(p);
  const Eigen::Vector3d p_truth = T_truth_map_[place] * (p + origin_);
  const auto surface = truth_.surface_height(p_truth.x(), p_truth.y());
  if (!surface) return std::nullopt;
  return p_truth.z() - *surface;
}

bool Footprint::contains(const Eigen::Vector2d& p, double margin_m) const {
  const Eigen::Vector2d d = p - centre;
  const double along = heading.dot(d);
  const double across = heading.x() * d.y() - heading.y() * d.x();
  return std::abs(along) <= half_length + margin_m && std::abs(across) <= half_width + margin_m;
}

std::vector<Footprint> footprints_of(const std::vector<maps::MapObject>& objects,
                                     const Eigen::Vector3d& origin) {
  std::vector<Footprint> footprints;
  for (const maps::MapObject& object : objects) {
    if (object.points_removed == 0) continue;
    if (!(object.size_m.maxCoeff() <= kMostSizeM))
      throw std::invalid_argument("objects: one is longer than 200 m");
    for (const maps::MapObject::Placement& placement : object.placements) {
      const Eigen::Vector3d centre = placement.centre_map - origin;
      footprints.push_back({.centre = centre.head<2>(),
                            .heading = {std::cos(placement.yaw_rad), std::sin(placement.yaw_rad)},
                            .half_length = 0.5 * object.size_m.x(),
                            .half_width = 0.5 * object.size_m.y(),
                            .bottom = centre.z() - 0.5 * object.size_m.z(),
                            .moving = object.motion == maps::ObjectMotion::kMoving});
    }
  }
  return footprints;
}

bool is_across_step(const Footprint& footprint, const TrueHeights& heights) {
  const auto samples = [](double half) {
    return static_cast<int>(std::floor(2.0 * half / kSampleM)) + 1;
  };
  const int along = samples(footprint.half_length);
  const int across = samples(footprint.half_width);
  const Eigen::Vector2d left(-footprint.heading.y(), footprint.heading.x());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  std::vector<double> before(static_cast<std::size_t>(across), nan);
  for (int i = 0; i < along; ++i) {
    double beside = nan;
    for (int k = 0; k < across; ++k) {
      const Eigen::Vector2d p = footprint.centre +
                                (kSampleM * i - footprint.half_length) * footprint.heading +
                                (kSampleM * k - footprint.half_width) * left;
      // Height 0 less its own height over the surface: the surface, wherever that is.
      const auto over = heights.over_surface({p.x(), p.y(), footprint.bottom});
      const double here = over ? -*over : nan;
      double& last = before[static_cast<std::size_t>(k)];
      if (std::abs(here - beside) > kStepM || std::abs(here - last) > kStepM) return true;
      beside = last = here;
    }
  }
  return false;
}

FootprintIndex::FootprintIndex(std::vector<Footprint> footprints)
    : footprints_(std::move(footprints)) {
  for (std::size_t i = 0; i < footprints_.size(); ++i) {
    for_each_cell(footprints_[i], kMostMarginM, kIndexCellM, [&](std::int64_t x, std::int64_t y) {
      cells_[maps::plane_cell_key(x, y)].push_back(static_cast<std::uint32_t>(i));
    });
  }
}

void FootprintIndex::for_each_at(const Eigen::Vector2d& p, double margin_m,
                                 const std::function<void(std::size_t)>& visit) const {
  const std::vector<std::uint32_t>* found = cells_.find(
      maps::plane_cell_key(cell_along(p.x(), kIndexCellM), cell_along(p.y(), kIndexCellM)));
  if (found == nullptr) return;
  for (const std::uint32_t i : *found) {
    if (footprints_[i].contains(p, margin_m)) visit(i);
  }
}

FootprintGround::FootprintGround(const std::vector<Footprint>& footprints,
                                 const TrueHeights& heights) {
  for (const Footprint& footprint : footprints) {
    if (footprint.moving) continue;
    for_each_cell(footprint, 0.0, kFootprintCellM, [&](std::int64_t x, std::int64_t y) {
      const Eigen::Vector2d middle((static_cast<double>(x) + 0.5) * kFootprintCellM,
                                   (static_cast<double>(y) + 0.5) * kFootprintCellM);
      const Eigen::Vector3d p(middle.x(), middle.y(), footprint.bottom);
      if (!footprint.contains(middle) || !heights.over_surface(p)) return;
      const auto band =
          std::lower_bound(kDistancesM.begin(), kDistancesM.end(), heights.path_distance(p));
      cells_.insert(maps::plane_cell_key(x, y),
                    Cell{static_cast<std::uint8_t>(band - kDistancesM.begin()), 0});
    });
  }
}

void FootprintGround::add(const Eigen::Vector3d& p, bool filled, const TrueHeights& heights) {
  Cell* const found = cells_.find(
      maps::plane_cell_key(cell_along(p.x(), kFootprintCellM), cell_along(p.y(), kFootprintCellM)));
  const std::uint8_t bit = filled ? kFilledBit : kProjectedBit;
  if (found == nullptr || (found->met & bit) != 0) return;
  const auto over = heights.over_surface(p);
  if (!over) return;
  const bool right = std::abs(*over) <= kSameHeightM;
  found->met = static_cast<std::uint8_t>(found->met | (right ? bit : kWrongBit));
}

std::vector<GroundUnderBand> FootprintGround::bands() const {
  std::vector<GroundUnderBand> bands;
  for (const double to_m : kDistancesM) bands.push_back({to_m, {}});
  for (const auto& [key, cell] : cells_) {
    GroundUnder& ground = bands[cell.band].ground;
    ++ground.projected.of;
    ++ground.filled.of;
    ground.projected.count += (cell.met & kProjectedBit) != 0 ? 1 : 0;
    ground.filled.count += (cell.met & (kProjectedBit | kFilledBit)) != 0 ? 1 : 0;
    ground.wrong += cell.met == kWrongBit ? 1 : 0;
  }
  return bands;
}

GroundUnder FootprintGround::all() const {
  GroundUnder sum;
  for (const GroundUnderBand& band : bands()) {
    const GroundUnder& ground = band.ground;
    sum.projected.count += ground.projected.count;
    sum.filled.count += ground.filled.count;
    sum.projected.of += ground.projected.of;
    sum.filled.of += ground.filled.of;
    sum.wrong += ground.wrong;
  }
  return sum;
}

HeightErrors height_errors(std::vector<double> heights_m) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  HeightErrors errors{heights_m.size(), kNaN, kNaN, {}};
  if (heights_m.empty()) return errors;
  for (double& height : heights_m) height = std::abs(height);
  std::sort(heights_m.begin(), heights_m.end());
  for (std::size_t percent = 0; percent <= 100; ++percent) {
    // The smallest value that at least this share of all does not exceed.
    const std::size_t rank = (percent * heights_m.size() + 99) / 100;
    errors.percentiles_m.push_back(heights_m[std::max<std::size_t>(rank, 1) - 1]);
  }
  errors.median_m = errors.percentiles_m[50];
  errors.p95_m = errors.percentiles_m[95];
  return errors;
}

}  // namespace stillmap::mapping

#include <stillmap/localization/localizability.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include "index/index_grid.hpp"
#include "index/index_window.hpp"
#include "index/map_level.hpp"
#include "noise_information.hpp"
#include "registration.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

namespace stillmap::localization {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr std::size_t kFinestPerSide = 4;
constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
constexpr double kRangeM = 50.0;
/// Edge of the voxels [m].
constexpr float kEdgeM = 1.0F;
/// Of a sensor with 1024 columns and 64 rings over 45 degrees.
constexpr double kColumnRad = 2.0 * kPi / 1024.0;
constexpr double kRingRad = kPi / 4.0 / 64.0;
constexpr double kHighestTan = 0.4142135623730951;
/// Directions in which the nearest wall is remembered.
constexpr std::size_t kSectors = 180;
/// Information of so many voxels, spread evenly, counts as whole.
constexpr double kWhole = 100.0;
constexpr double kUsualHeightM = 1.8;

bool is_of_the_ground(maps::PointKind kind) { return kind != maps::PointKind::kMeasured; }

/// Lowest ground of each cell, relative to the map's origin.
class GroundHeights {
 public:
  explicit GroundHeights(const maps::MapPackage& map) : map_(map), tiles_(maps::finest_tiles(map)) {
    side_ = maps::cells_per_side(tiles_.size(), kFinestPerSide);
  }

  /// @return false when it was told to stop.
  bool read(const maps::GoOn& go_on) {
    const std::size_t cells = side_ * side_;
    std::vector<float> lowest(tiles_.size() * cells, kNone);
    values_ = lowest;
    bool knows_ground = false;
    for (std::size_t i = 0; i < tiles_.size(); ++i) {
      if (go_on && !go_on()) return false;
      const maps::MapTile tile = map_.tile(tiles_[i]);
      for (const maps::MapPoint& point : tile) {
        const Eigen::Vector3d p = tile.from_origin(point);
        const std::size_t at = i * cells + maps::cell_of(tiles_[i], side_, p.x(), p.y());
        const auto height = static_cast<float>(p.z());
        if (!(lowest[at] <= height)) lowest[at] = height;
        if (!is_of_the_ground(point.kind)) continue;
        knows_ground = true;
        if (!(values_[at] <= height)) values_[at] = height;
      }
    }
    if (!knows_ground) values_ = std::move(lowest);
    return true;
  }

  [[nodiscard]] const std::vector<maps::TileId>& tiles() const { return tiles_; }
  [[nodiscard]] std::size_t side() const { return side_; }
  [[nodiscard]] const std::vector<float>& values() const { return values_; }
  /// NaN where there is none.
  [[nodiscard]] float below(const Eigen::Vector3d& p) const {
    const auto number = [](double x) {
      return static_cast<std::int32_t>(std::floor(x / maps::kTileSizeM));
    };
    const maps::TileId tile{.level = 0, .x = number(p.x()), .y = number(p.y())};
    const auto found = std::lower_bound(tiles_.begin(), tiles_.end(), tile);
    if (found == tiles_.end() || *found != tile) return kNone;
    return values_[static_cast<std::size_t>(found - tiles_.begin()) * side_ * side_ +
                   maps::cell_of(tile, side_, p.x(), p.y())];
  }

 private:
  const maps::MapPackage& map_;
  std::vector<maps::TileId> tiles_;
  std::size_t side_ = 1;
  std::vector<float> values_;
};

/// Of the sensors that made the map, above the ground [m].
double sensor_height_m(const maps::MapPackage& map, const GroundHeights& ground) {
  std::vector<double> heights;
  for (const maps::Trajectory& drive : map.trajectories()) {
    for (const maps::StampedPose& pose : drive.poses()) {
      const Eigen::Vector3d p = pose.T_map_lidar.translation() - map.manifest().origin;
      const double height = p.z() - static_cast<double>(ground.below(p));
      if (height > 0.3 && height < 5.0) heights.push_back(height);
    }
  }
  if (heights.empty()) return kUsualHeightM;
  const auto middle = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2);
  std::nth_element(heights.begin(), middle, heights.end());
  return *middle;
}

/// A voxel, and where it lies in the window.
struct PlacedVoxel {
  const Voxel* voxel = nullptr;
  Eigen::Vector3f mean = Eigen::Vector3f::Zero();
};

/// Voxels around a region that tell something of a horizontal place, found by squares.
class TellingVoxels {
 public:
  /// @param level  of a region's window.
  explicit TellingVoxels(const MapIndex::Level& level) {
    const int reach = static_cast<int>(std::ceil(kRangeM / static_cast<double>(level.edge_m)));
    const int side = cells_of_region(static_cast<double>(level.edge_m));
    level.cells.for_each_near(
        Eigen::Array2i::Constant(-reach), Eigen::Array2i::Constant(side + reach),
        [&](const Eigen::Array3i& /*cell*/, const Voxel& voxel, const CellBlocks::TileView& tile) {
          if (voxel.sharp_axes <= 0 || !(std::abs(voxel.axis0.z()) < kUprightCosine)) return;
          const Eigen::Vector3f mean = voxel.mean + tile.corner;
          squares_[{square_of(mean.x()), square_of(mean.y())}].push_back({&voxel, mean});
        });
  }

  template <typename Take>
  void near(const Eigen::Vector3d& p, Take&& take) const {
    const int reach = static_cast<int>(std::ceil(kRangeM / kSquareM));
    const int x = square_of(static_cast<float>(p.x()));
    const int y = square_of(static_cast<float>(p.y()));
    for (int column = x - reach; column <= x + reach; ++column) {
      const auto end = squares_.upper_bound({column, y + reach});
      for (auto each = squares_.lower_bound({column, y - reach}); each != end; ++each)
        for (const PlacedVoxel& placed : each->second) take(placed);
    }
  }

 private:
  static constexpr double kSquareM = 10.0;
  /// What lies flatter says next to nothing of where one is along the ground.
  static constexpr float kUprightCosine = 0.9F;
  static int square_of(float x) { return static_cast<int>(std::floor(x / kSquareM)); }
  std::map<std::pair<int, int>, std::vector<PlacedVoxel>> squares_;
};

/// A voxel as a sensor sees it.
struct Sight {
  const Voxel* voxel = nullptr;
  Eigen::Vector3d from_sensor = Eigen::Vector3d::Zero();
  double range_m = 0.0;
  std::size_t sector = 0;
};

std::size_t sector_of(double azimuth_rad) {
  const double share = (azimuth_rad + kPi) / (2.0 * kPi);
  const auto sector = static_cast<std::size_t>(std::max(0.0, share * kSectors));
  return sector % kSectors;
}

/// What is in reach of a sensor, without what the nearest walls hide.
class View {
 public:
  /// @param p  of the sensor, relative to the window's origin.
  void look(const TellingVoxels& voxels, const Eigen::Vector3d& p) {
    sights_.clear();
    nearest_m_.fill(std::numeric_limits<double>::infinity());
    voxels.near(
        p, [&](const PlacedVoxel& placed) { add(*placed.voxel, placed.mean.cast<double>() - p); });
    std::erase_if(sights_, [&](const Sight& sight) {
      return sight.range_m > nearest_m_[sight.sector] + 1.5 * static_cast<double>(kEdgeM);
    });
  }
  [[nodiscard]] const std::vector<Sight>& sights() const { return sights_; }

 private:
  void add(const Voxel& voxel, const Eigen::Vector3d& from_sensor) {
    const double range_m = from_sensor.head<2>().norm();
    const double edge_m = static_cast<double>(kEdgeM);
    if (!(range_m <= kRangeM && range_m > 0.5 * edge_m)) return;
    if (std::abs(from_sensor.z()) > kHighestTan * range_m) return;
    const double azimuth_rad = std::atan2(from_sensor.y(), from_sensor.x());
    sights_.push_back({.voxel = &voxel,
                       .from_sensor = from_sensor,
                       .range_m = range_m,
                       .sector = sector_of(azimuth_rad)});
    const bool hides = voxel.sharp_axes == 1 && std::abs(voxel.axis0.z()) < 0.5F &&
                       std::abs(from_sensor.z()) <= edge_m;
    if (!hides) return;
    // Its width as it is seen: a wall along the line of sight hides little.
    const Eigen::Vector2d across = Eigen::Vector2d(-from_sensor.y(), from_sensor.x()) / range_m;
    const Eigen::Vector2d along_wall(-static_cast<double>(voxel.axis0.y()),
                                     static_cast<double>(voxel.axis0.x()));
    const double half_m = 0.5 * edge_m * std::abs(across.dot(along_wall));
    const double half_rad = std::atan2(half_m, range_m);
    const double step_rad = 2.0 * kPi / static_cast<double>(kSectors);
    for (double turn = -half_rad; turn <= half_rad; turn += step_rad)
      hide(sector_of(std::remainder(azimuth_rad + turn, 2.0 * kPi)), range_m);
    hide(sector_of(std::remainder(azimuth_rad + half_rad, 2.0 * kPi)), range_m);
  }
  void hide(std::size_t sector, double range_m) {
    nearest_m_[sector] = std::min(nearest_m_[sector], range_m);
  }

  std::vector<Sight> sights_;
  std::array<double, kSectors> nearest_m_{};
};

/// Beams that hit it, at most one: the aligner thins what is denser.
double weight_of(const Sight& sight) {
  const double distance2 = sight.from_sensor.squaredNorm();
  const double facing =
      std::abs(sight.voxel->axis0.cast<double>().dot(sight.from_sensor)) / std::sqrt(distance2);
  const double edge_m = static_cast<double>(kEdgeM);
  return std::min(1.0, edge_m * edge_m * facing / (distance2 * kColumnRad * kRingRad));
}

Eigen::Vector3d jacobian_of(const Eigen::Vector3d& axis, const Eigen::Vector3d& r) {
  return {axis.x(), axis.y(), (r.x() * axis.y() - r.y() * axis.x()) / kLeverM};
}

struct Told {
  float localizability = 0.0F;
  float weak_direction_rad = kNone;
};

Told told_by(const std::vector<Sight>& sights) {
  Eigen::Matrix3d measured = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d feigned = Eigen::Matrix3d::Zero();
  for (const Sight& sight : sights) {
    const Voxel& voxel = *sight.voxel;
    const double weight = weight_of(sight);
    const Eigen::Vector3d J = jacobian_of(voxel.axis0.cast<double>(), sight.from_sensor);
    measured += weight * J * J.transpose();
    const std::array<Eigen::Vector3d, 2> others = {voxel.axis1.cast<double>(),
                                                   voxel.axis0.cross(voxel.axis1).cast<double>()};
    const std::array<float, 2> variances = {voxel.variance1, voxel.variance2};
    for (std::size_t other = 0; other < 2; ++other) {
      const double tilt =
          tilt_variance(static_cast<double>(voxel.variance0), static_cast<double>(variances[other]),
                        static_cast<double>(voxel.points));
      const Eigen::Vector3d J_other = jacobian_of(others[other], sight.from_sensor);
      feigned += weight * tilt * J_other * J_other.transpose();
    }
  }
  const maps::SymmetricEigen<3> eigen = maps::eigen_of(measured);
  const Eigen::Vector3d weakest = eigen.vectors.col(0);
  const double told = eigen.values[0] - kLeastOverNoise * weakest.dot(feigned * weakest);
  Told result;
  result.localizability = static_cast<float>(
      std::clamp(3.0 * told / std::max(measured.trace(), 3.0 * kWhole), 0.0, 1.0));
  if (!sights.empty() && weakest.head<2>().squaredNorm() >= 0.5) {
    double direction = std::atan2(weakest.y(), weakest.x());
    if (direction <= -kPi / 2.0) direction += kPi;
    if (direction > kPi / 2.0) direction -= kPi;
    result.weak_direction_rad = static_cast<float>(direction);
  }
  return result;
}

const MapIndex::Level& level_of(const IndexWindow& window) {
  return *std::min_element(window.levels().begin(), window.levels().end(),
                           [](const MapIndex::Level& a, const MapIndex::Level& b) {
                             return std::abs(a.edge_m - kEdgeM) < std::abs(b.edge_m - kEdgeM);
                           });
}

/// Middle of a cell, relative to the map's origin.
Eigen::Vector2d middle_of(const maps::TileId& tile, std::size_t cell, std::size_t side) {
  const double edge_m = maps::kTileSizeM / static_cast<double>(side);
  return {maps::kTileSizeM * tile.x + edge_m * (static_cast<double>(cell % side) + 0.5),
          maps::kTileSizeM * tile.y + edge_m * (static_cast<double>(cell / side) + 0.5)};
}

}  // namespace

std::optional<maps::TileLayer> localizability_of(const maps::MapPackage& map, const MapIndex& index,
                                                 const maps::GoOn& go_on) {
  GroundHeights ground(map);
  if (!ground.read(go_on)) return std::nullopt;
  const double height_m = sensor_height_m(map, ground);
  maps::TileLayer layer{.cells_per_side = ground.side(), .tiles = ground.tiles(), .bands = {}};
  const std::vector<float> none(ground.values().size(), kNone);
  layer.bands = {{.name = "height", .unit = "m", .values = ground.values()},
                 {.name = "localizability", .unit = "", .values = none},
                 {.name = "weak_direction", .unit = "rad", .values = none}};
  // Region by region, so that the voxels of one alone are at hand.
  std::map<maps::RegionId, std::vector<std::size_t>> tiles_of_region;
  for (std::size_t tile = 0; tile < layer.tiles.size(); ++tile)
    tiles_of_region[maps::region_of(layer.tiles[tile])].push_back(tile);
  View view;
  for (const auto& [region, tiles] : tiles_of_region) {
    const auto window = index.around(region);
    const TellingVoxels voxels(level_of(*window));
    const Eigen::Vector3d offset = map.manifest().origin - window->origin();
    for (const std::size_t tile : tiles) {
      if (go_on && !go_on()) return std::nullopt;
      for (std::size_t cell = 0; cell < layer.cells_per_tile(); ++cell) {
        const std::size_t at = tile * layer.cells_per_tile() + cell;
        const float floor = ground.values()[at];
        if (std::isnan(floor)) continue;
        Eigen::Vector3d sensor;
        sensor << middle_of(layer.tiles[tile], cell, ground.side()),
            static_cast<double>(floor) + height_m;
        view.look(voxels, sensor + offset);
        const Told told = told_by(view.sights());
        layer.bands[1].values[at] = told.localizability;
        layer.bands[2].values[at] = told.weak_direction_rad;
      }
    }
  }
  return layer;
}

}  // namespace stillmap::localization

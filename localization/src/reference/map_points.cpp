#include "reference/map_points.hpp"

#include "index/measured_points.hpp"
#include "index/voxel_table.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <fmt/format.h>
#include <nanoflann.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace stillmap::localization {
namespace {

constexpr float kFarthestM = 500.0F;
constexpr std::size_t kMostRead = 400'000;
/// Neighbours that a surface is fitted to, the point itself among them.
constexpr std::uint32_t kNeighbours = 16;
constexpr std::size_t kLeafPoints = 10;
/// An axis is sharp when its variance is below this share of the next one's.
constexpr double kLineShare = 0.2;
/// Cosine of 25 degrees: a line that lies is usually one ring of the sensor, and its place across
/// tells nothing.
constexpr float kUprightAxis = 0.9F;

/// Sums by cell.
class CentroidGrid {
 public:
  explicit CentroidGrid(double leaf_m) : leaf_m_(leaf_m) {}

  void add(const Eigen::Vector3d& p) {
    const Eigen::Array3i cell =
        (p / leaf_m_).array().floor().cast<std::int32_t>() + kCellsPerAxis / 2;
    const auto [index, inserted] = table_.insert(cell_key(cell.x(), cell.y(), cell.z()));
    if (inserted) {
      sums_.emplace_back(Eigen::Vector3d::Zero());
      counts_.push_back(0);
    }
    sums_[index] += p;
    ++counts_[index];
  }

  [[nodiscard]] std::size_t size() const { return sums_.size(); }
  [[nodiscard]] Eigen::Vector3f centroid(std::size_t index) const {
    return (sums_[index] / static_cast<double>(counts_[index])).cast<float>();
  }

 private:
  double leaf_m_;
  VoxelTable table_;
  std::vector<Eigen::Vector3d> sums_;
  std::vector<std::uint32_t> counts_;
};

void require_edge(double leaf_m) {
  if (!(leaf_m > 0.0 && std::isfinite(leaf_m))) {
    throw std::invalid_argument(fmt::format("leaf_m: {}, > 0", leaf_m));
  }
}

}  // namespace

std::vector<Eigen::Vector3f> thinned(std::span<const Eigen::Vector3f> points_lidar, double leaf_m) {
  require_edge(leaf_m);
  CentroidGrid grid(leaf_m);
  const std::size_t step = points_lidar.size() / kMostRead + 1;
  for (std::size_t i = 0; i < points_lidar.size(); i += step) {
    const Eigen::Vector3f& p = points_lidar[i];
    if (p.squaredNorm() < kFarthestM * kFarthestM) grid.add(p.cast<double>());
  }
  std::vector<Eigen::Vector3f> centroids(std::min(grid.size(), kMaxThinnedPoints));
  for (std::size_t i = 0; i < centroids.size(); ++i) {
    centroids[i] = grid.centroid(i * grid.size() / centroids.size());
  }
  return centroids;
}

class MapPoints::Tree {
 public:
  explicit Tree(const std::vector<Point>& points)
      : view_{points}, tree_(3, view_, nanoflann::KDTreeSingleIndexAdaptorParams(kLeafPoints)) {}

  /// Fills `indices` with up to its size of nearest points within `max_distance2`, nearest first.
  /// @return how many there are.
  std::size_t nearest(const Eigen::Vector3f& p, float max_distance2,
                      std::span<std::uint32_t> indices) const {
    std::array<float, kNeighbours> distances2{};
    nanoflann::KNNResultSet<float, std::uint32_t> found(indices.size());
    found.init(indices.data(), distances2.data());
    // The set takes what is nearer than its last entry, which init() has set to the largest float.
    distances2[indices.size() - 1] = max_distance2;
    tree_.findNeighbors(found, p.data(), nanoflann::SearchParams());
    return found.size();
  }

 private:
  /// What nanoflann reads.
  struct View {
    const std::vector<Point>& points;
    [[nodiscard]] std::size_t kdtree_get_point_count() const { return points.size(); }
    [[nodiscard]] float kdtree_get_pt(std::size_t index, std::size_t axis) const {
      return points[index].position[static_cast<Eigen::Index>(axis)];
    }
    template <typename Box>
    bool kdtree_get_bbox(Box& /*box*/) const {
      return false;
    }
  };
  View view_;
  nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, View>, View, 3,
                                      std::uint32_t>
      tree_;
};

MapPoints::MapPoints() = default;
MapPoints::~MapPoints() = default;

const MapPoints::Point* MapPoints::nearest(const Eigen::Vector3f& p, float max_distance_m) const {
  std::array<std::uint32_t, 1> index{};
  return tree_->nearest(p, max_distance_m * max_distance_m, index) == 0 ? nullptr
                                                                        : &points_[index[0]];
}

bool MapPoints::within_bounds(const Eigen::Vector3d& p, double margin_m) const {
  return ((p - min_).array() > -margin_m).all() && ((p - max_).array() < margin_m).all();
}

void MapPoints::find_surfaces() {
  std::array<std::uint32_t, kNeighbours> indices{};
  for (Point& point : points_) {
    const std::size_t count =
        tree_->nearest(point.position, std::numeric_limits<float>::max(), indices);
    if (count < kNeighbours) continue;
    Eigen::Matrix3d outer = Eigen::Matrix3d::Zero();
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const std::uint32_t index : indices) {
      const Eigen::Vector3d offset = (points_[index].position - point.position).cast<double>();
      sum += offset;
      outer += offset * offset.transpose();
    }
    const maps::SymmetricEigen<3> eigen = maps::eigen_of(
        Eigen::Matrix3d(outer / kNeighbours - sum * sum.transpose() / (kNeighbours * kNeighbours)));
    const Eigen::Vector3d& variances = eigen.values;
    point.axes = {eigen.vectors.col(0).cast<float>(), eigen.vectors.col(1).cast<float>()};
    if (variances[1] < kLineShare * variances[2]) {
      point.sharp_axes = std::abs(eigen.vectors(2, 2)) > kUprightAxis ? 2 : 0;
    } else {
      point.sharp_axes = variances[0] < kLineShare * variances[1] ? 1 : 0;
    }
  }
}

template <typename ForEachPoint>
std::shared_ptr<const MapPoints> MapPoints::build_from(const ForEachPoint& for_each_point,
                                                       const std::string& source, double leaf_m) {
  require_edge(leaf_m);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Vector3d min = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Vector3d max = -min;
  std::size_t count = 0;
  for_each_point([&](const Eigen::Vector3d& p_map) {
    if (!p_map.allFinite()) throw std::invalid_argument(source + ": a point is not finite");
    sum += p_map;
    min = min.cwiseMin(p_map);
    max = max.cwiseMax(p_map);
    ++count;
  });
  if (count == 0) throw maps::InputError(source, "no measured point", "one or more");
  constexpr std::int32_t kMostCells = kCellsPerAxis / 2 - 1;
  const double limit_m = leaf_m * kMostCells;
  if (!((max - min).maxCoeff() < limit_m)) {
    throw maps::InputError(source, fmt::format("an extent of {} m", (max - min).maxCoeff()),
                           fmt::format("less than {} m", limit_m));
  }
  std::shared_ptr<MapPoints> map(new MapPoints());
  map->origin_ = sum / static_cast<double>(count);
  map->min_ = min - map->origin_;
  map->max_ = max - map->origin_;
  CentroidGrid grid(leaf_m);
  for_each_point([&](const Eigen::Vector3d& p_map) { grid.add(p_map - map->origin_); });
  map->points_.resize(grid.size());
  for (std::size_t i = 0; i < grid.size(); ++i) map->points_[i].position = grid.centroid(i);
  map->tree_ = std::make_unique<const Tree>(map->points_);
  map->find_surfaces();
  return map;
}

std::shared_ptr<const MapPoints> MapPoints::build(const maps::MapPackage& map, double leaf_m) {
  const auto for_each_point = [&](const auto& visit) {
    for (const maps::TileEntry& entry : map.tiles()) {
      if (entry.id.level != 0) continue;
      for_each_measured_point(map, entry.id,
                              [&](const Eigen::Vector3d& p, const maps::MapPoint& /*point*/) {
                                visit(map.manifest().origin + p);
                              });
    }
  };
  return build_from(for_each_point, map.folder().string(), leaf_m);
}

std::shared_ptr<const MapPoints> MapPoints::build(const std::vector<Eigen::Vector3d>& points_map,
                                                  double leaf_m) {
  const auto for_each_point = [&](const auto& visit) {
    for (const Eigen::Vector3d& p_map : points_map) visit(p_map);
  };
  return build_from(for_each_point, "map points", leaf_m);
}

}  // namespace stillmap::localization

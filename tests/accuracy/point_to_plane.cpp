// GCC 12 warns of Eigen's umeyama(), inlined here through PCL's headers: see
// mapping/src/reference/pcl_icp.cpp.
#pragma GCC diagnostic ignored "-Warray-bounds"

#include "accuracy/point_to_plane.hpp"

#include <stillmap/maps/frames.hpp>

#include <pcl/features/normal_3d.h>
#include <pcl/point_types.h>
#include <pcl/registration/icp.h>
#include <pcl/search/kdtree.h>

#include <algorithm>
#include <cstdint>
#include <stdexcept>
#include <utility>

namespace stillmap::test {
namespace {

using Point = pcl::PointNormal;
using Cloud = pcl::PointCloud<Point>;
using Tree = pcl::search::KdTree<Point>;

constexpr std::size_t kMinPoints = 100;
/// About a disc of 0.25 m on a surface that is sampled every 0.1 m.
constexpr int kNormalNeighbours = 20;
constexpr int kMaxSteps = 100;

/// Mean of the points in each voxel. Not by `pcl::VoxelGrid`, which counts voxels in 32 bits: a map
/// of 250 m has more of this size.
Cloud::Ptr thinned(const std::vector<Eigen::Vector3f>& points) {
  std::vector<std::pair<std::uint64_t, std::size_t>> cells;
  cells.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Array3d cell = (points[i].cast<double>() / kReferenceLeafM).array().floor();
    // 21 bits an axis: 100 km to either side.
    const auto bits = [](double value) { return static_cast<std::uint64_t>(value + 0x1p20); };
    cells.emplace_back(bits(cell.x()) << 42 | bits(cell.y()) << 21 | bits(cell.z()), i);
  }
  std::sort(cells.begin(), cells.end());
  Cloud::Ptr out(new Cloud);
  for (std::size_t begin = 0, end = 0; begin < cells.size(); begin = end) {
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    for (; end < cells.size() && cells[end].first == cells[begin].first; ++end)
      sum += points[cells[end].second];
    Point mean;
    mean.getVector3fMap() = sum / static_cast<float>(end - begin);
    out->push_back(mean);
  }
  return out;
}

/// By the plane through each point's neighbours; which side they show to does not matter here.
void set_normals(Cloud& cloud, const Tree& tree) {
  pcl::Indices neighbours;
  std::vector<float> distance2;
  for (Point& point : cloud) {
    tree.nearestKSearch(point, kNormalNeighbours, neighbours, distance2);
    Eigen::Vector4f plane;
    pcl::computePointNormal(cloud, neighbours, plane, point.curvature);
    point.getNormalVector3fMap() = plane.head<3>();
  }
}

}  // namespace

struct PointToPlaneReference::Target {
  /// Added to PCL's float coordinates [m].
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  Cloud::Ptr cloud;
  Tree::Ptr tree;
};

PointToPlaneReference::PointToPlaneReference(const std::vector<Eigen::Vector3d>& points_map) {
  if (points_map.size() < kMinPoints)
    throw std::invalid_argument("point to plane: fewer than 100 points in the map");
  auto target = std::make_unique<Target>();
  for (const Eigen::Vector3d& p : points_map)
    target->origin += p / static_cast<double>(points_map.size());
  std::vector<Eigen::Vector3f> points;
  points.reserve(points_map.size());
  for (const Eigen::Vector3d& p : points_map)
    points.emplace_back((p - target->origin).cast<float>());
  target->cloud = thinned(points);
  target->tree.reset(new Tree);
  target->tree->setInputCloud(target->cloud);
  set_normals(*target->cloud, *target->tree);
  target_ = std::move(target);
}

PointToPlaneReference::~PointToPlaneReference() = default;

std::optional<Eigen::Isometry3d> PointToPlaneReference::align(
    const std::vector<Eigen::Vector3f>& scan_lidar,
    const Eigen::Isometry3d& T_map_lidar_start) const {
  pcl::IterativeClosestPointWithNormals<Point, Point> icp;
  icp.setInputSource(thinned(scan_lidar));
  icp.setInputTarget(target_->cloud);
  icp.setSearchMethodTarget(target_->tree, true);
  icp.setMaximumIterations(kMaxSteps);
  struct Stage {
    double pair_distance_m, step_m;
  };
  Eigen::Isometry3d T = T_map_lidar_start;
  T.translation() -= target_->origin;
  Cloud aligned;
  for (const Stage& stage : {Stage{1.0, 1e-3}, Stage{0.3, 1e-4}}) {
    icp.setMaxCorrespondenceDistance(stage.pair_distance_m);
    icp.setTransformationEpsilon(stage.step_m * stage.step_m);  // PCL wants its square
    // The cosine of the step's angle; in float it is not known better than this.
    icp.setTransformationRotationEpsilon(1.0 - 1e-6);
    icp.align(aligned, T.matrix().cast<float>());
    const Eigen::Matrix4d found = icp.getFinalTransformation().cast<double>();
    if (icp.getConvergeCriteria()->getConvergenceState() !=
            pcl::registration::DefaultConvergenceCriteria<float>::CONVERGENCE_CRITERIA_TRANSFORM ||
        !found.allFinite()) {
      return std::nullopt;
    }
    T = maps::renormalized(Eigen::Isometry3d(found));
  }
  T.translation() += target_->origin;
  return T;
}

}  // namespace stillmap::test

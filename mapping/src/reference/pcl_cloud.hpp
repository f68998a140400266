#pragma once

// PCL is slow to read: only for the .cpp files of the reference methods.

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/scan.hpp>

#include <pcl/point_types.h>
#include <pcl/registration/registration.h>
#include <pcl/search/kdtree.h>
#include <Eigen/Core>

#include <optional>
#include <string>
#include <vector>

/// What PCL's methods share behind our interface.
namespace stillmap::mapping::reference {

using PclPoint = pcl::PointXYZ;
using PclCloud = pcl::PointCloud<PclPoint>;
using PclTree = pcl::search::KdTree<PclPoint>;

/// A map as PCL takes it: float coordinates about a middle of their own.
struct PclMap {
  /// Added to PCL's coordinates [m].
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  PclCloud::Ptr cloud;
  PclTree::Ptr tree;
};

/// One point, their mean, in each voxel.
[[nodiscard]] PclCloud::Ptr thinned(const PclCloud::ConstPtr& cloud, double leaf_m);

/// @param leaf_m  thinned to one point in a voxel of this edge; nothing keeps all.
/// @throws std::invalid_argument, naming the method, without points.
[[nodiscard]] PclMap map_for(const std::string& method,
                             const std::vector<Eigen::Vector3d>& points_map,
                             std::optional<double> leaf_m);

/// One question: a thinned scan and where to start.
struct PclQuery {
  PclCloud::Ptr source;
  /// Relative to the map's origin.
  Eigen::Matrix4f start = Eigen::Matrix4f::Identity();
};

/// @param answer  `lost` with its reason when nothing is returned.
/// @throws std::invalid_argument for a scan or prior that is not finite.
[[nodiscard]] std::optional<PclQuery> query_of(const maps::PointCloud& scan_lidar,
                                               const std::optional<localization::Prior>& given,
                                               const PclMap& map, double leaf_m,
                                               localization::AlignmentResult& answer);

/// Runs the method from the query's start and takes over what it says.
///
/// Status is what PCL says (`hasConverged`); it gives no covariance, so the covariance is zero.
/// Inlier ratio and rmse count scan points with a map point within one leaf.
void run(pcl::Registration<PclPoint, PclPoint>& method, const PclQuery& query, const PclMap& map,
         double leaf_m, localization::AlignmentResult& answer);

}  // namespace stillmap::mapping::reference

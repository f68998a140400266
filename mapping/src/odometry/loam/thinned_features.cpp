#include "odometry/loam/thinned_features.hpp"

#include <stillmap/maps/cell_table.hpp>

namespace stillmap::mapping::loam {

std::vector<Feature> thinned(const std::vector<Feature>& features, double voxel_m) {
  maps::CellTable taken(features.size() / 2);
  std::vector<Feature> out;
  for (const Feature& feature : features) {
    const Eigen::Array3i voxel =
        (feature.position / static_cast<float>(voxel_m)).array().floor().cast<int>();
    if (taken.insert(maps::signed_cell_key(voxel.x(), voxel.y(), voxel.z())).second)
      out.push_back(feature);
  }
  return out;
}

}  // namespace stillmap::mapping::loam

#include <stillmap/maps/scan.hpp>

#include <algorithm>
#include <numeric>
#include <stdexcept>

namespace stillmap::maps {
namespace {

/// Moves the kept values to the front. Nothing to do for an attribute that is not there.
template <typename Value>
void compact(std::vector<Value>& values, const std::vector<std::uint8_t>& keep) {
  if (values.empty()) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < keep.size(); ++i) {
    values[kept] = values[i];
    kept += keep[i] != 0 ? 1 : 0;
  }
  values.resize(kept);
}

}  // namespace

void PointCloud::keep_only(const std::vector<std::uint8_t>& keep) {
  if (keep.size() != size())
    throw std::invalid_argument("flags: " + std::to_string(keep.size()) +
                                ", expected one for each of " + std::to_string(size()) + " points");
  if (std::find(keep.begin(), keep.end(), 0) == keep.end()) return;
  if (file_indices.empty()) {
    file_indices.resize(size());
    std::iota(file_indices.begin(), file_indices.end(), 0U);
  }
  compact(positions, keep);
  compact(intensities, keep);
  compact(time_offsets_s, keep);
  compact(file_indices, keep);
  compact(lidars, keep);
}

PointCloud PointCloud::of_lidar(std::size_t lidar) const {
  PointCloud cloud = *this;
  std::vector<std::uint8_t> keep(size());
  for (std::size_t i = 0; i < size(); ++i) {
    keep[i] = lidars[i] == lidar ? 1 : 0;
    cloud.positions[i] = ray(i);
  }
  cloud.keep_only(keep);
  cloud.lidars.clear();
  cloud.lidar_origins.clear();
  return cloud;
}

}  // namespace stillmap::maps

#pragma once

#include <stillmap/maps/scan.hpp>

#include <utility>
#include <vector>

namespace stillmap::test {

/// Points alone.
[[nodiscard]] inline maps::PointCloud cloud_of(std::vector<Eigen::Vector3f> positions) {
  maps::PointCloud cloud;
  cloud.positions = std::move(positions);
  return cloud;
}

}  // namespace stillmap::test

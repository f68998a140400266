#pragma once

#include "core/top_view.hpp"

#include <stillmap/mapping/label_evaluation.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <vector>

namespace stillmap::mapping {

inline constexpr Colour kParkedColour{255, 150, 40};
inline constexpr Colour kMovingColour{90, 200, 255};

/// A picture of a map's extent with nothing in it yet, from the map's origin [m].
[[nodiscard]] TopView empty_view(const maps::MapPackage& map);

/// Draws what was measured beside what the map holds, both in the map's extent.
class BeforeAndAfter {
 public:
  explicit BeforeAndAfter(const maps::MapPackage& map);

  /// @param positions  from the map's origin [m].
  void add_scan(const std::vector<Eigen::Vector3f>& positions);
  [[nodiscard]] MapPictures finish();

 private:
  const maps::MapPackage& map_;
  TopView before_;
};

}  // namespace stillmap::mapping

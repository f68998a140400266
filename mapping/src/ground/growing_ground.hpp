#pragma once

#include "ground/height_grid.hpp"

#include <stillmap/mapping/ground.hpp>

namespace stillmap::mapping {

/// Ground by growing outward from the plane under the sensor.
///
/// The lowest points of 1 m cells near the sensor give a seed plane. Cells are then visited from
/// near to far: each is predicted from the ground already found around it (local plane with a prior
/// on its slope), and is ground when points lie near that prediction; points farther below are
/// reflections and are passed over. Cells that disagree with all their neighbours are taken back.
/// Last, gaps of up to 8 m are filled.
class GrowingGround final : public GroundSegmenter {
 public:
  [[nodiscard]] GroundResult segment(const maps::PointCloud& cloud) const override;
  void learn(const maps::PointCloud& /*cloud*/) override {}
};

}  // namespace stillmap::mapping

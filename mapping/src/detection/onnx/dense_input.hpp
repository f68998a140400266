#pragma once

#include "detection/onnx/onnx_config.hpp"
#include "detection/onnx/onnx_session.hpp"

#include <stillmap/mapping/ground.hpp>
#include <stillmap/maps/scan.hpp>

#include <optional>
#include <vector>

namespace stillmap::mapping {

/// The network's z of things in a scan.
class OnnxZ {
 public:
  /// @param surface  may be null: no ground is known anywhere.
  OnnxZ(const OnnxConfig& config, const GroundSurface* surface);
  /// z [m, lidar frame] of the network's zero at x, y [m, lidar frame]. None with kGround where no
  /// ground is known. With kLidar the same everywhere; where no ground is known under the sensor,
  /// the scan's own zero.
  [[nodiscard]] std::optional<double> zero_at(double x, double y) const;

 private:
  const GroundSurface* surface_ = nullptr;
  bool over_ground_ = false;
  double zero_ = 0.0;
};

/// The tensor [1, channels, rows, columns] of `config.bev`.
[[nodiscard]] OnnxTensor bev_tensor(const OnnxConfig& config, const maps::PointCloud& cloud,
                                    const OnnxZ& z);

struct Pillars {
  /// [P, most_points, features]
  OnnxTensor points;
  /// [P, 4] and [P], of int64; see PillarInput.
  OnnxTensor cells, counts;
};

/// The tensors of `config.pillars`, ascending by row, then column; a pillar's points in the order
/// of the scan.
[[nodiscard]] Pillars pillar_tensors(const OnnxConfig& config, const maps::PointCloud& cloud,
                                     const OnnxZ& z);

}  // namespace stillmap::mapping

#pragma once

#include <stillmap/mapping/ground.hpp>

#include <Eigen/Core>

#include <optional>

namespace stillmap::mapping {

/// The ground straight below the points of one scan, whatever "down" is for it: along the lidar's
/// z for a surface of that scan alone, along the map's z for one in the map frame.
class GroundBelow {
 public:
  struct Foot {
    /// On the ground, straight below (or above) the point asked for; lidar frame [m].
    Eigen::Vector3f position = Eigen::Vector3f::Zero();
    /// Of the point over its foot [m], negative below the ground.
    double height_m = 0.0;
    /// Points labelled ground that stand no higher than this are ground even in a box [m], > 0:
    /// what the surface itself may be wrong by.
    double tolerance_m = 0.0;
    /// As `GroundSurface::Sample`.
    double confidence = 0.0;
  };
  virtual ~GroundBelow() = default;
  /// @param p  lidar frame [m], finite.
  /// @return nothing where no ground is known. Safe from several threads.
  [[nodiscard]] virtual std::optional<Foot> below(const Eigen::Vector3f& p) const = 0;
};

/// The surface of one scan alone, down along the lidar's z.
class BelowLocal final : public GroundBelow {
 public:
  /// @param surface  must outlive this.
  explicit BelowLocal(const GroundSurface& surface) : surface_(surface) {}
  [[nodiscard]] std::optional<Foot> below(const Eigen::Vector3f& p) const override;

 private:
  const GroundSurface& surface_;
};

}  // namespace stillmap::mapping

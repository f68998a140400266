#pragma once

#include <Eigen/Geometry>

#include <cstdint>
#include <memory>
#include <optional>

#include "world.hpp"

namespace stillmap::simulation {

/// What a ray met.
struct Hit {
  double range_m = 0.0;
  /// Cosine of the angle between ray and surface normal, in [0, 1].
  double cos_incidence = 0.0;
  Surface surface = Surface::kWall;
  /// Index into World::actors; none for what cannot move.
  std::optional<std::size_t> actor;
};

/// The world as Embree casts rays into it. `cast` may be called from several threads, `set_time`
/// not while it is.
class RayScene {
 public:
  /// @param world  must outlive the scene.
  explicit RayScene(const World& world);
  ~RayScene();
  RayScene(const RayScene&) = delete;
  RayScene& operator=(const RayScene&) = delete;

  /// Moves every actor to where it is at this time.
  void set_time(double time_s);
  /// First hit from `origin` along the unit vector `direction`, both in the world's frame, within
  /// [min_range_m, max_range_m].
  [[nodiscard]] std::optional<Hit> cast(const Eigen::Vector3d& origin,
                                        const Eigen::Vector3d& direction, double min_range_m,
                                        double max_range_m) const;

 private:
  struct Embree;
  const World& world_;
  std::unique_ptr<Embree> embree_;
};

}  // namespace stillmap::simulation

#pragma once

#include "odometry/loam/features.hpp"
#include "odometry/loam/surfaces.hpp"

#include <Eigen/Core>

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

namespace stillmap::mapping::loam {

/// Features of the sweep before, all moved to its stamp, that lines and planes are looked for in.
///
/// The nearest point j is found in a kd-tree; the others, which must lie on rings of their own, by
/// azimuth in the rings beside (section V.B, Fig. 7).
class RingSearch {
 public:
  /// @param features  ring by ring.
  explicit RingSearch(std::span<const Feature> features);
  ~RingSearch();
  RingSearch(RingSearch&&) noexcept;
  RingSearch& operator=(RingSearch&&) noexcept;

  /// Edge line of eq. (2): j the nearest point, l the nearest on a ring beside that of j.
  [[nodiscard]] std::optional<Surface> line_near(const Eigen::Vector3f& X) const;
  /// Planar patch of eq. (3): j the nearest point, l the next on the ring of j, m the nearest on a
  /// ring beside.
  [[nodiscard]] std::optional<Surface> plane_near(const Eigen::Vector3f& X) const;

 private:
  struct Tree;
  struct Found {
    std::uint32_t index = 0;
    float squared = 0.0F;
  };
  [[nodiscard]] std::optional<Found> nearest(const Eigen::Vector3f& X) const;
  [[nodiscard]] std::optional<Found> nearest_in_ring(const Eigen::Vector3f& X, std::uint32_t ring,
                                                     std::uint32_t except) const;
  [[nodiscard]] std::optional<Found> nearest_beside(const Eigen::Vector3f& X,
                                                    std::uint32_t ring) const;

  [[nodiscard]] const Eigen::Vector3f& point(std::uint32_t index) const;

  std::vector<std::uint32_t> rings_;
  std::vector<float> azimuths_;
  /// Where each ring starts.
  std::vector<std::uint32_t> starts_;
  std::unique_ptr<Tree> tree_;
};

}  // namespace stillmap::mapping::loam

#pragma once

#include <Eigen/Core>

#include <array>
#include <optional>
#include <span>

namespace stillmap::mapping::loam {

/// What a feature is measured against. Its distance to a plane is n_1 (X - a); to a line the root
/// of the squares of n_1 (X - a) and n_2 (X - a), n_1 and n_2 across the line. The sum of squares
/// is that of eq. (2), and has a derivative where the distance is 0.
struct Surface {
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  std::array<Eigen::Vector3d, 2> normals{};
  /// 1 for a plane, 2 for a line.
  int rows = 0;
  /// Of its rows.
  double weight = 1.0;

  [[nodiscard]] double distance(const Eigen::Vector3d& X) const;
};

/// Line through j and l, eq. (2). @return nothing when the two are one.
[[nodiscard]] std::optional<Surface> line_through(const Eigen::Vector3d& j,
                                                  const Eigen::Vector3d& l);

/// Plane through j, l and m, eq. (3). @return nothing when they lie on a line, or nearly.
[[nodiscard]] std::optional<Surface> plane_through(const Eigen::Vector3d& j,
                                                   const Eigen::Vector3d& l,
                                                   const Eigen::Vector3d& m);

/// By the eigenvalues of neighbours' covariance (section VI of the paper): one much larger than
/// the other two is a line along its eigenvector; two, a plane. @return nothing for neither.
/// @param neighbours  relative to `centre`, 3 or more.
[[nodiscard]] std::optional<Surface> line_of(std::span<const Eigen::Vector3f> neighbours,
                                             const Eigen::Vector3d& centre);
[[nodiscard]] std::optional<Surface> plane_of(std::span<const Eigen::Vector3f> neighbours,
                                              const Eigen::Vector3d& centre);

}  // namespace stillmap::mapping::loam

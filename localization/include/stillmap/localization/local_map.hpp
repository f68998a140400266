#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

namespace stillmap::localization {

/// Where a scan lies in a `LocalMap`.
struct LocalAlignment {
  Eigen::Isometry3d T_odom_lidar = Eigen::Isometry3d::Identity();
  /// As in `AlignmentResult`.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  /// As in `AlignmentResult`: along these the pose means nothing.
  std::vector<Eigen::Matrix<double, 6, 1>> degenerate_directions;
  /// Share of the points that lie on the map's surfaces, in [0, 1].
  double inlier_ratio = 0.0;
  /// The same of the points around which the map knows anything; and of those that stand above the
  /// ground, of which less fits by chance. 0 where there are none.
  double known_inlier_ratio = 0.0;
  double standing_ratio = 0.0;
  /// Mean over all points of how well they lie on a surface, from 1 for one on it to 0 for those
  /// that meet none: what tells better poses of one scan from worse.
  double fit = 0.0;
  /// Root mean square distance of the inliers to their surface [m].
  double rmse_m = 0.0;
  /// Points that tell where the scan is; with fewer than `kMinMatched` there is no pose.
  std::size_t matched = 0;

  static constexpr std::size_t kMinMatched = 50;
};

/// What a moving sensor has lately seen around it, as voxels that scans are aligned with: those of
/// a `MapIndex` (2, 1, 0.5 m) and the same registration, but growing scan by scan.
///
/// Memory is bounded: cells farther than `kReachM` from the sensor are forgotten, and a cell that
/// is full takes no more. Same calls, same bits.
class LocalMap {
 public:
  /// Points farther from the sensor are left out, cells farther away forgotten [m].
  static constexpr double kReachM = 100.0;

  LocalMap();
  ~LocalMap();
  LocalMap(LocalMap&&) noexcept;
  LocalMap& operator=(LocalMap&&) noexcept;

  /// Adds a scan and moves the map's centre to its sensor.
  /// @param points_lidar  N points [m], deskewed to one instant; every one counts the same, so
  /// thinned evenly. Those that are not finite are left out.
  /// @throws std::invalid_argument if the pose is not finite.
  void add(std::span<const Eigen::Vector3f> points_lidar, const Eigen::Isometry3d& T_odom_lidar);

  /// Voxels of all levels.
  [[nodiscard]] std::size_t voxel_count() const;

  /// Coarse to fine alignment from a guess, as `refine` does it: directions that the points do not
  /// constrain are left where they are.
  /// @param points_lidar  N points [m], finite, deskewed; some thousands, spread evenly.
  /// @param off_m  how far the guess may be off at `kLeverM` from the sensor: wider kernels and
  /// coarser voxels come first where it is more [m], > 0.
  /// @throws std::invalid_argument if the guess or a point is not finite.
  [[nodiscard]] Eigen::Isometry3d refined(std::span<const Eigen::Vector3f> points_lidar,
                                          const Eigen::Isometry3d& T_odom_lidar_guess,
                                          double off_m) const;

  /// The best of the places within 6 m and 0.4 rad of a guess (`search_poses`), coarsely aligned;
  /// the guess itself is among them. For where nothing better is known.
  [[nodiscard]] Eigen::Isometry3d searched(std::span<const Eigen::Vector3f> points_lidar,
                                           const Eigen::Isometry3d& T_odom_lidar_guess) const;

  /// What the map says about a pose that `refined` found.
  [[nodiscard]] LocalAlignment judged(std::span<const Eigen::Vector3f> points_lidar,
                                      const Eigen::Isometry3d& T_odom_lidar) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace stillmap::localization

#pragma once

#include <stillmap/localization/map_index.hpp>
#include <stillmap/localization/options.hpp>
#include <stillmap/localization/reason.hpp>
#include <stillmap/localization/thinning.hpp>
#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::localization {

enum class PoseStatus {
  kOk,        ///< the pose is as good as its covariance says
  kDegraded,  ///< a pose, but weakly constrained or poorly supported
  kLost,      ///< no pose: do not use `T_map_lidar`
};
[[nodiscard]] std::string_view name_of(PoseStatus status);

/// Bounds that the errors of an `ok` pose stay within: P(|error| > level) <= 1e-3 on each axis, as
/// calibrated on simulated drives of other days (localization/how_it_works.md). Infinite: no
/// bound.
struct ProtectionLevels {
  /// Along x, y and z of the frame that the covariance is given in (forward, left, up for a base)
  /// [m].
  double longitudinal_m = std::numeric_limits<double>::infinity();
  double lateral_m = std::numeric_limits<double>::infinity();
  double vertical_m = std::numeric_limits<double>::infinity();
  /// About z [rad].
  double yaw_rad = std::numeric_limits<double>::infinity();
};
/// @param covariance  of a pose answered by the method `default`, order as in `AlignmentResult`; a
///                    zero or non-finite variance has no bound.
[[nodiscard]] ProtectionLevels protection_levels(const Eigen::Matrix<double, 6, 6>& covariance);

/// Answer to "where was this scan taken?".
struct AlignmentResult {
  PoseStatus status = PoseStatus::kLost;
  /// Why not ok; empty when it is.
  std::vector<Reason> reasons;
  Eigen::Isometry3d T_map_lidar = Eigen::Isometry3d::Identity();
  /// Rows tx ty tz [m], rx ry rz [rad]; perturbation on the right, in the lidar frame.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  /// In the lidar frame; infinite unless `kOk`.
  ProtectionLevels protection;
  /// Share of the thinned scan's points that are explained by the map, in [0, 1].
  double inlier_ratio = 0.0;
  /// Root mean square distance of inliers to the map's surfaces [m].
  double rmse_m = 0.0;
  /// Unit directions that the scan does not constrain, in the covariance's order, rotations
  /// counted in metres at 15 m: divide the last three by 15 m for a motion in metres and radians.
  std::vector<Eigen::Matrix<double, 6, 1>> degenerate_directions;
  int iterations = 0;
};

/// Protection levels in the base frame: the covariance is carried over by the mount's adjoint
/// (`T_map_lidar exp(x) T_lidar_base = T_map_lidar T_lidar_base exp(Ad(T_base_lidar) x)`), then as
/// above. Infinite where any of the result's own is: what is not bounded in the lidar frame is not
/// in base.
/// @param T_base_lidar  mount of the sensor: rigid, finite.
[[nodiscard]] ProtectionLevels protection_levels_in_base(const AlignmentResult& result,
                                                         const Eigen::Isometry3d& T_base_lidar);

/// Where a scan is believed to be before it is matched.
struct Prior {
  Eigen::Isometry3d T_map_lidar = Eigen::Isometry3d::Identity();
  /// Same order and frame as the result's; when given, a pose that contradicts it is not `kOk`,
  /// and the search reaches as far as three deviations: where these are more than
  /// `AlignerOptions::search_radius_m` and `search_yaw_rad` (GNSS), to all places in reach that the
  /// map was made from. Without it as far as these two, and when nothing fits there, to such places
  /// within `lost_radius_m` and `lost_yaw_rad`.
  std::optional<Eigen::Matrix<double, 6, 6>> covariance;
};

/// Aligns scans with one map, from a prior or, where the method can, without one.
class Aligner {
 public:
  virtual ~Aligner() = default;
  Aligner() = default;
  Aligner(const Aligner&) = delete;
  Aligner& operator=(const Aligner&) = delete;

  /// @param scan_lidar         N points [m] in the lidar frame, finite. With `time_offsets_s` the
  ///                           method `default` finds the sensor's motion from the map and answers
  ///                           with the pose at the stamp; otherwise, and for the other methods,
  ///                           deskewed to one instant. Without times a scan that fits clearly
  ///                           better as that of a moving, spinning sensor is `not_deskewed`: not
  ///                           `kOk`, with the pose where that looked along +x.
  /// @param prior              where the search starts; none = anywhere in the map. Then the lidar
  ///                           must be mounted within some degrees as the one that made the map.
  /// @return  `kLost` with a reason when the scan cannot be matched (also for an empty or tiny
  /// scan); `needs_prior` from a method, or for a map, that cannot be searched without one.
  /// @throws std::invalid_argument if a number is not finite, a rotation or a covariance is none,
  ///         there are times but not one a point, or one is 10 s and more.
  /// @note   Safe from several threads. Same input, same bits.
  [[nodiscard]] virtual AlignmentResult align(const maps::PointCloud& scan_lidar,
                                              const std::optional<Prior>& prior) const = 0;

  /// The points of a scan that this method looks at: those of `thin_points` for the method
  /// `default`, all of them for the others. No returns are left out.
  [[nodiscard]] virtual ThinScan thin(const ScanView& scan_lidar) const;
  /// As `align`, of a scan that was thinned before: `align(scan)` is `align_thin(thin(scan))`, to
  /// the bit. A vehicle that thins its scans need not send the rest. The other methods take the
  /// points for the scan.
  /// @throws std::invalid_argument as `align`, and if it was thinned for a vehicle of another size.
  [[nodiscard]] virtual AlignmentResult align_thin(const ThinScan& scan_lidar,
                                                   const std::optional<Prior>& prior) const;
};

/// Names for `make_aligner`, the default first.
[[nodiscard]] std::vector<std::string> aligner_names();

/// Where a map was seen from: the poses of its trajectories; for a map from elsewhere that has
/// none, its places.
[[nodiscard]] std::vector<Eigen::Isometry3d> seen_from(const maps::MapPackage& map);

/// Any method for a map: `default` over its index (`MapIndex::open`, which may write files), `icp`
/// and `point_to_plane` over its measured points. Those two need a prior.
/// @param method     one of `aligner_names()`.
/// @param options    of the method `default`; the other two have none.
/// @throws std::invalid_argument naming the method and the choices, or every broken option;
/// maps::InputError if the map holds nothing to align with.
[[nodiscard]] std::unique_ptr<Aligner> make_aligner(std::string_view method,
                                                    const maps::MapPackage& map,
                                                    const LocalizationOptions& options = {});

/// The method `default` over an index alone.
/// @param method     "default".
/// @param T_map_lidar_seen_from  poses that the map was made from, finite. Without a prior a scan
///                   is looked for within some 6 m of them, upright as they are, in every heading;
///                   empty = those that the index's map was made from, and of bare points none.
///                   The map around each of these places is read here.
/// @throws std::invalid_argument naming the method and the choices, or a pose that is not finite;
/// with poses, maps::InputError and maps::StorageError when a region of the index cannot be read.
[[nodiscard]] std::unique_ptr<Aligner> make_aligner(
    std::string_view method, std::shared_ptr<const MapIndex> index,
    const std::vector<Eigen::Isometry3d>& T_map_lidar_seen_from = {},
    const LocalizationOptions& options = {});

}  // namespace stillmap::localization

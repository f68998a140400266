#pragma once

#include <stillmap/mapping/cleaning.hpp>

#include <cstdint>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// Defaults are the paper's, the same for every sensor and place.
struct DufomapOptions {
  /// Edge of a voxel [m], in [0.01, 10]; v of the paper.
  double voxel_m = 0.1;
  /// A ray's last metres belong to the surface [m], in [0, 10]; d_s of the paper, which stands for
  /// the noise of ranges. More keeps more of the static map and of what moves.
  double hit_distance_m = 0.2;
  /// So many voxels around an empty one must be observed too, in [0, 7]; d_p of the paper, which
  /// stands for errors of poses. More keeps more of the static map and of what moves.
  int unknown_voxels = 1;

  [[nodiscard]] std::vector<std::string> violations() const;
};

/// Points in regions that some scan saw to be void belong to what moved.
///
/// Of each scan by itself: voxels on the last d_s of any ray are hit; from the sensor to its end or
/// to the first hit voxel a ray makes voxels free, that one and the next d_p included; a voxel is
/// void when it is free, not hit, and all voxels within d_p (Chebyshev) of it are free or hit. A
/// map point whose voxel is void in any scan goes. Nothing is known of ground or of objects.
///
/// Beyond some 15 to 20 m neighbouring rays of a LiDAR leave voxels of 0.1 m between them unknown,
/// so little is void there: what moves only farther off stays, as does what only stands.
///
/// Reproduced: the paper's method and parameters; one ray a voxel, to its centre, as in the
/// authors' program ("down-sampling method: center").
/// Departures: the map's points are classified, which are means of voxels, instead of raw points
/// (the same where the map's voxels are those of the method); a hit voxel that no ray came to
/// counts as observed, as in the text, and not as unknown, as in the program; rays longer than
/// 500 m are left out; only void voxels in blocks of 0.8 m that hold a map point are remembered,
/// since no other is asked for, so memory grows with the map and not with what the rays pass; scans
/// are taken several at once, which changes no bit since void regions are joined by "or".
///
/// Memory: 76 bytes a block of 8 x 8 x 8 voxels with a map point and 2 KiB a group of 512 such
/// blocks, 30 to 85 MB for a kilometre of simulated road at 0.1 m; some 10 MB a thread, and its
/// scan.
/// @see Duberg, Zhang, Jia, Jensfelt, "DUFOMap: Efficient Dynamic Awareness Mapping", RA-L 9(6),
///      2024.
class DufomapCleaner : public Cleaner {
 public:
  /// @throws std::invalid_argument naming each broken option.
  explicit DufomapCleaner(const DufomapOptions& options = {});
  /// @throws std::invalid_argument as well when a point or pose is too far from the origin.
  [[nodiscard]] std::vector<std::uint8_t> moved(const CleaningPoints& points,
                                                const ScanSource& scans,
                                                const ProgressCallback& progress,
                                                const CancelFlag& cancel) const override;

 private:
  DufomapOptions options_;
};

}  // namespace stillmap::mapping

#pragma once

#include <stillmap/mapping/cleaning.hpp>
#include <stillmap/mapping/ground.hpp>
#include <stillmap/mapping/map_consistency.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/mapping/projection.hpp>
#include <stillmap/mapping/trajectory.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/drive_check.hpp>
#include <stillmap/maps/map_package.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// What is done with the drives' own poses.
enum class GivenPosesUse {
  /// Neighbouring scans are registered with the given poses as a prior as wide as they disagree;
  /// the frame stays theirs (`TrajectoryOptions::refine_given`). Poses that agree with the scans'
  /// own motion stay as they are.
  kRefine,
  /// Taken as they are, and compared with the scans' own motion.
  kExact,
};
[[nodiscard]] std::string_view name_of(GivenPosesUse use);

struct MapBuildOptions {
  /// Of each drive.
  maps::Selection selection;
  /// Every n-th of the selected scans of each drive stays out of the map, to be asked for later; 0
  /// = none, else at least 2.
  std::size_t held_back_every = 0;
  /// Poses instead of the drive's own; with one drive only.
  std::optional<std::filesystem::path> poses_file;
  /// Added to the stamps of the given poses [s], in [-1e9, 1e9]. A rebuild adds it to those of the
  /// drive that is held back, too.
  double pose_time_offset_s = 0.0;
  /// Besides, what the scans' own motion says is added for each drive, where it is more than 0.05 s
  /// (mapping/given_poses.md#faults-of-given-poses); costs odometry once more.
  bool finds_pose_time_offset = false;
  /// Where the frame of the given poses lies (x east, y north), for drives that do not say it.
  std::optional<maps::GeodeticOrigin> geodetic_origin;
  /// `given`: the drives' own poses, see `given_poses`; or one of `odometry_names()`. None: `given`
  /// where every drive has poses, else the first of these.
  std::optional<std::string> odometry;
  GivenPosesUse given_poses = GivenPosesUse::kRefine;
  /// With odometry: loops, a prior, GNSS. Its method, scans and threads are set by the build.
  TrajectoryOptions trajectory;
  /// A map package whose frame the new one is to stand in: poses are moved there by localizing
  /// scans in it, or kept where they agree with it (mapping/registration.md).
  std::optional<std::filesystem::path> register_to;
  /// With `register_to`: poses are moved however little, and bent to follow the map where scans are
  /// localized in it. So a patch of the map meets it without a seam (mapping/patches.md).
  bool follows_map = false;
  GroundOptions ground;
  /// `geometric`, `voxelnext`, `voxelnext:FILE`, `onnx:FILE`, or `boxes:FILE` (with several drives
  /// `boxes:FILE,FILE...`, one a drive).
  std::string detector = "voxelnext";
  ProjectionOptions projection;
  /// Join what was detected in all scans into objects, so that a car that was missed in some scans
  /// goes from all of them, and project onto the ground of all scans. Without it every scan is on
  /// its own, as in the paper.
  bool fusion = true;
  /// A user's corrections, see `edits.hpp`; only with `fusion`.
  std::optional<std::filesystem::path> edits_file;
  /// Fill the ground where objects stood and nothing was projected to; only with `fusion` and
  /// where objects are projected, otherwise nothing is filled.
  bool fill = true;
  /// Cleaning method: `free-space`, `none`, or one that the factory given to `build_map` knows.
  std::string clean = "free-space";
  /// Edge of the voxels that merge points of the map [m], in [0.02, 2].
  double voxel_size_m = 0.1;
  /// Points nearer are the vehicle itself (bonnet and tail of a car reach 2.5 m from a sensor on
  /// its roof), farther ones too sparse [m]; both are dropped and counted, and it is a warning when
  /// more than a fifth are too near, as in a small room. In [0, 20] and [5, 300], the second
  /// larger.
  double min_range_m = 2.7;
  double max_range_m = 80.0;
  /// In [0, 256], 0 = all cores.
  int threads = 0;
  /// Where the journals lie. There they stay when the map is done, and another build whose scans
  /// would be surveyed alike takes them over. None: in the package while it is written.
  std::optional<std::filesystem::path> journal_folder;
  /// Look for objects also where they are kept, so that the journal is that of a build in which
  /// they are not.
  bool detect_always = false;

  /// Scans of a drive of `size` scans that the map is made from, and those that are held back: each
  /// lies between two that the map is made from.
  [[nodiscard]] std::vector<std::size_t> scans_of(std::size_t size) const;
  [[nodiscard]] std::vector<std::size_t> held_back_of(std::size_t size) const;
  [[nodiscard]] bool detects() const {
    return detect_always || projection.policy != MovablePolicy::kKeep;
  }
  [[nodiscard]] std::vector<std::string> violations() const;
  /// Whether ground is filled: only where objects of all scans are projected, see `fill`.
  [[nodiscard]] bool fills_ground() const {
    return fusion && fill && projection.policy == MovablePolicy::kProject;
  }
};

/// Options as a build uses them: a network's boxes are grown by at least 0.2 m to every side.
[[nodiscard]] MapBuildOptions completed(MapBuildOptions options);

/// Turns options into the paper's method: no fusion, boxes as they were detected, everything in
/// them to the scan's mean ground height, nothing filled, nothing cleaned. The detector stays, and
/// so do edits, which are then refused with `fusion` off.
void apply_paper_preset(MapBuildOptions& options);

/// How far given poses were from the scans' own motion, and what was done about it.
struct GivenPosesResult {
  GivenPosesUse use = GivenPosesUse::kRefine;
  GivenPoseErrors errors;
  /// Neighbouring scans that disagree by more than a voxel.
  std::size_t neighbours_apart = 0;
  /// What scans were moved by; no pairs where their poses stay.
  PoseDifferences moved;
};

/// What a build did; the same numbers stand in the manifest (`counts`) and in build.json.
struct MapBuildResult {
  std::size_t scans = 0;
  /// Of these, scans that a build that was killed had surveyed.
  std::size_t resumed_scans = 0;
  double seconds = 0.0;
  double scans_per_second = 0.0;
  double peak_rss_mib = 0.0;
  /// in, ground, projected, deleted, cleaned, filled, static, ...; where scans are hidden
  /// (`OdometryPose::hidden`), scans_hidden and dropped_hidden, their points, too.
  std::map<std::string, std::uint64_t> points;
  /// parked, moving, unknown, boxes, "dropped: REASON", ...
  std::map<std::string, std::uint64_t> objects;
  /// With odometry: key_frames, loops_found, loops_believed, scans_predicted (by motion alone).
  std::map<std::string, std::uint64_t> trajectory;
  /// Of poses that the drives bring.
  std::optional<GivenPosesResult> given_poses;
  /// What looks wrong with the drives' own poses by the scans' motion, with the drive's name; also
  /// among the warnings.
  std::vector<maps::DriveFinding> pose_faults;
  /// Of each drive, what `finds_pose_time_offset` added [s]; empty without it.
  std::vector<double> found_pose_time_offsets_s;
  /// Of the finished map, as `map_consistency` finds in the package.
  MapConsistency consistency;
  /// Summed over threads; with what the resumed scans took in the build that was killed.
  std::map<std::string, double> stage_seconds;
  /// What a person should look at: edits that met nothing, work of a killed build that was thrown
  /// away, a `min_range_m` that leaves out much, hidden scans.
  std::vector<std::string> warnings;
  /// What was found of the drives' IMUs, for people.
  std::vector<std::string> notes;
  /// With `register_to`.
  std::optional<maps::Registration> registration;
  /// Of a build by units (`build_units.hpp`): sum of the journals that the map was made from.
  std::string merged_from;
  std::string digest;
};

/// Drives -> one projected static map package at `target`, in memory that grows with the map's area
/// and, by some 30 KiB a scan, with their number.
///
/// Where poses are not given they are estimated first (`estimate_trajectories`), over all scans
/// from the first selected one to the last. With `register_to` they are then brought into that
/// map's frame. Each scan is surveyed: read -> drop -> deskew -> ground -> detect. Then objects and
/// ground are fused over all scans. Each scan is placed from its original points: project -> stack.
/// Last, each tile is finished: clean -> fill -> normals. Scans and tiles are processed in parallel
/// and taken in order, so that the bytes do not depend on the number of threads. A build that fails
/// leaves nothing behind.
///
/// The estimated poses, and what the survey found scan by scan, are written down beside the target,
/// for when the build is cancelled, the process killed or out of memory: the same call then goes on
/// from there, to the same bytes. What a build of other options, another program or other scans
/// left is thrown away, with a warning.
/// @param drives        at least one; given poses are in one frame, or each has a geodetic origin.
/// @param make_cleaner  for other names than `free-space` and `none`; may be empty.
/// @throws std::invalid_argument (options), maps::InputError, maps::StorageError, Cancelled.
MapBuildResult build_map(const std::vector<std::filesystem::path>& drives,
                         const std::filesystem::path& target, const MapBuildOptions& options,
                         const ProgressCallback& progress, const CancelFlag& cancel,
                         const CleanerFactory& make_cleaner = {});

/// Whether a build would estimate the poses of these drives, rather than take or refine them.
/// @throws as `build_map`.
[[nodiscard]] bool estimates_poses(const std::vector<std::filesystem::path>& drives,
                                   const MapBuildOptions& options);

/// The object of `--json` and of a package's build.json.
[[nodiscard]] std::string to_json(const MapBuildResult& result);

}  // namespace stillmap::mapping

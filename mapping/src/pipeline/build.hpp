#pragma once

#include "drives/drive_set.hpp"
#include "pipeline/build_journal.hpp"
#include "pipeline/fuse_stage.hpp"
#include "pipeline/place_stage.hpp"
#include "pipeline/poses_stage.hpp"
#include "pipeline/survey_stage.hpp"
#include "registration/build_frame.hpp"
#include "stacking/voxel_grid.hpp"

#include <stillmap/mapping/cleaning.hpp>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/edits.hpp>
#include <stillmap/maps/map_object.hpp>
#include <stillmap/maps/map_package.hpp>

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// Options as a build uses them. @throws std::invalid_argument naming a broken one.
[[nodiscard]] MapBuildOptions usable(const MapBuildOptions& given);

/// Drives as they are opened, and what was found of their IMUs, for people.
struct DrivesOfBuild {
  std::vector<maps::Drive> drives;
  std::vector<std::string> notes;
};
[[nodiscard]] DrivesOfBuild open_for_build(const std::vector<std::filesystem::path>& folders,
                                           const MapBuildOptions& options,
                                           const ProgressCallback& progress,
                                           const CancelFlag& cancel);

/// What a build is asked to do and where it works; the same for all of its stages.
struct BuildTask {
  const MapBuildOptions& options;
  /// `given`, or the method that makes the poses.
  std::string odometry;
  /// Folders of the drives.
  std::vector<std::filesystem::path> folders;
  /// Drives as they were opened.
  std::vector<maps::Drive> drives;
  std::filesystem::path journal_folder;
  /// For what does not stay in memory; removed at the end.
  std::filesystem::path scratch;
  maps::Edits edits;
  /// A method that needs the whole map at once; nullptr = `options.clean` is ours or none.
  const Cleaner* cleaner;
  /// None where a unit does another part of a build than the package.
  maps::MapPackageWriter* writer;
  const ProgressCallback& progress;
  const CancelFlag& cancel;
  /// How the journals of the poses are used: most units read what one of them found.
  BuildJournal::Use poses_journal = BuildJournal::Use::kWrite;
};

/// A build on its way: each stage leaves its members for those after it.
struct Build {
  explicit Build(const BuildTask& build_task) : task(build_task) {}
  // Members refer to each other.
  Build(const Build&) = delete;
  Build& operator=(const Build&) = delete;

  /// @throws Cancelled where the build is to stop.
  void stop_if_cancelled() const {
    if (task.cancel) throw Cancelled();
  }
  void tell(std::string_view stage, std::size_t done, std::size_t total) const {
    if (task.progress) task.progress(stage, done, total);
  }

  const BuildTask& task;
  const std::chrono::steady_clock::time_point began = std::chrono::steady_clock::now();
  MapBuildResult result;

  /// By `shift_poses`: the drives with their poses at the right time.
  std::vector<maps::Drive> shifted;
  /// By `find_poses`; `drives` moves into the member below.
  PosedDrives posed;
  /// By `register_poses`: of the map that the options name.
  std::optional<BuildFrame> frame;
  /// By `select_scans`: what the map is made of, and its voxels.
  std::optional<DriveSet> drives;
  std::optional<VoxelGrid> grid;
  std::vector<maps::PoseDisagreement> disagreements;
  /// By `survey_scans`.
  std::optional<ScanWork> scan_work;
  std::unique_ptr<Survey> survey;
  /// By `fuse_objects`.
  BuildObjects objects;
  /// By `place_scans`.
  std::unique_ptr<Placed> placed;
};

/// One stage of a build.
/// @throws maps::InputError, maps::StorageError, Cancelled.
using Stage = void (*)(Build& build);

/// Shifts given poses in time by what the scans' own motion says (`finds_pose_time_offset`), or a
/// killed build had found.
void shift_poses(Build& build);

/// Finds poses of all drives in one frame, or takes those that a killed build had found. Given ones
/// are compared with the scans' own motion, and refined where the options say so; others come from
/// odometry, loops and graph.
void find_poses(Build& build);

/// Moves the poses into the frame of the map that the options name, if they name one.
void register_poses(Build& build);

/// Numbers the selected scans through, lays out the map's voxels, and finds where poses disagree.
void select_scans(Build& build);

/// Surveys all scans, several at once, taken in their order: read, drop, deskew, ground, detect.
///
/// The journal holds a record a scan: those that are there are not computed again, those that are
/// not are appended. When a scan's file is another one than its record says, all records are
/// thrown away: another drive would be mixed in.
void survey_scans(Build& build);

/// Surveys a range of scans, and writes them down without keeping them.
/// @param stage  name of the journal.
void survey_range(Build& build, ScanRange range, const std::string& stage);

/// Gathers what was surveyed elsewhere. @param read  gives a scan by ordinal; called from several
/// threads at once.
void gather_survey(Build& build, const std::function<SurveyedScan(std::size_t scan)>& read);

/// Joins the boxes of all scans into objects (`options.fusion`), or makes an object of each; then a
/// user's corrections. The ground below objects that stood still is closed.
void fuse_objects(Build& build);

/// Projects and stacks all scans, several at once, in their order. Fates go to the package.
void place_scans(Build& build);

/// Cleans, fills and finishes all tiles, several at once, and writes them and the preview to the
/// package. Nothing is cleaned in regions that an edit keeps.
void finish_tiles(Build& build);

/// Writes objects, trajectories and sources, and gives the package its manifest and its place.
void write_package(Build& build);

}  // namespace stillmap::mapping

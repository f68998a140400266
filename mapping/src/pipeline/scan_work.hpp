#pragma once

#include "core/stage_timer.hpp"
#include "drives/drive_set.hpp"
#include "fusion/obstacle_map.hpp"
#include "ground/fused_ground.hpp"
#include "stacking/tile_stack.hpp"
#include "stacking/voxel_grid.hpp"
#include "views/own_vehicle.hpp"
#include "views/posed_views.hpp"
#include "views/range_view.hpp"

#include <stillmap/mapping/detector.hpp>
#include <stillmap/mapping/ground.hpp>
#include <stillmap/mapping/ground_below.hpp>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/mapping/projection.hpp>
#include <stillmap/maps/box.hpp>
#include <stillmap/maps/point_fates.hpp>

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::mapping {

using Counts = std::map<std::string, std::uint64_t>;

/// Scans by ordinal: the first, and one behind the last.
struct ScanRange {
  std::size_t begin = 0;
  std::size_t end = 0;
  [[nodiscard]] std::size_t size() const { return end - begin; }
};

/// What is found in one scan.
struct SurveyedScan {
  std::size_t scan = 0;
  /// Of the scan's file, lower-case hex.
  std::string sha256;
  /// One a point of the scan as `DriveSet::read` gives it.
  std::vector<bool> is_ground;
  /// As many, true = rain, snow or spray; empty in clear weather.
  std::vector<bool> weather;
  std::vector<maps::Box> boxes;
  GroundCells ground_cells;
  /// Only with the detector `geometric`.
  ScanObstacles obstacles;
  std::optional<RangeView> view;
  Counts counts;
  StageSeconds stage_seconds;
};

/// Flags of a scan's points that placing takes from the survey; as in `SurveyedScan`.
struct FoundInScan {
  std::vector<bool> is_ground;
  std::vector<bool> weather;
};

/// An object as it lies in one scan.
struct ScanObject {
  MovableBox movable;
  /// Index into the build's objects.
  std::uint32_t object = 0;
};

/// What is known of a scan when it is placed.
struct ScanToPlace {
  std::size_t number = 0;
  FoundInScan found;
  const std::vector<ScanObject>& objects;
  /// Regions in which every point stays; lidar frame.
  const std::vector<maps::Box>& kept;
};

/// What a placed scan gives to the map.
struct PlacedScan {
  PlacedScan(const VoxelGrid& grid, std::uint32_t scan) : voxels(grid, scan) {}

  ScanVoxels voxels;
  maps::ScanFates fates;
  /// One a point of the scan as `DriveSet::read` gives it: whether it was projected or deleted.
  std::vector<bool> in_object;
  /// By number of the object plus 1: such points.
  std::map<std::uint32_t, std::uint64_t> points_removed;
  Counts counts;
  StageSeconds stage_seconds;
};

/// Everything that is done to one scan, pure functions of drives and options. Safe from several
/// threads.
class ScanWork {
 public:
  /// @param drives, options  must outlive this.
  ScanWork(const DriveSet& drives, const MapBuildOptions& options, const VoxelGrid& grid);

  /// Ordinals of the scans that `learn` reads.
  [[nodiscard]] static std::vector<std::size_t> scans_to_learn_from(const DriveSet& drives);
  /// Adapts the ground stage to each drive by some of its scans, and finds what its vehicle carries
  /// or tows. Only of drives that have scans in a range.
  void learn(ScanRange range, const CancelFlag& cancel);

  /// Of the map.
  [[nodiscard]] const Eigen::Vector3d& origin() const { return grid_.origin(); }

  [[nodiscard]] SurveyedScan survey(std::size_t scan) const;
  /// @param ground  the fused surface; nullptr = that of the scan alone.
  /// @param views   of all scans.
  [[nodiscard]] PlacedScan place(const ScanToPlace& scan, const FusedGround* ground,
                                 const PosedViews& views) const;

  /// Boxes that were given but belong to no scan or are no object, by reason.
  [[nodiscard]] std::map<std::string, std::size_t> dropped_boxes() const;

 private:
  [[nodiscard]] maps::Scan read(std::size_t scan, Counts& counts, StageSeconds& seconds) const;
  /// "Local" as in `PosedScan`.
  [[nodiscard]] Eigen::Isometry3d T_local_lidar(std::size_t scan) const;

  [[nodiscard]] const GroundSegmenter& ground_of(std::size_t scan) const;
  /// None when nothing travels with the sensor.
  [[nodiscard]] const OwnVehicle* vehicle_of(std::size_t scan) const;

  const DriveSet& drives_;
  const MapBuildOptions& options_;
  const VoxelGrid& grid_;
  bool boxes_are_given_;
  /// One a drive.
  std::vector<std::unique_ptr<GroundSegmenter>> grounds_;
  std::vector<std::unique_ptr<Detector>> detectors_;
  /// One a drive once `learn` is done.
  std::vector<OwnVehicle> vehicles_;
};

}  // namespace stillmap::mapping

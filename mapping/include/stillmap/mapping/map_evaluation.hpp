#pragma once

#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>

namespace stillmap::mapping {

struct MapEvaluationOptions {
  /// Labelled boxes, see `maps::read_boxes`.
  std::filesystem::path boxes_file;
  /// Where `before.png` and `after.png` go; not drawn without it.
  std::optional<std::filesystem::path> pictures_folder;
};

/// How well a map got rid of what labels say can move, and what else it changed.
struct MapEvaluation {
  /// Scans that are in the map and carry at least one label.
  std::size_t scans = 0;
  double seconds = 0.0;
  /// Raw points of these scans inside a label of the same scan and more than 0.3 m over the ground.
  std::size_t box_points_before = 0;
  /// Those of them that the build left where they were: in no object that it found in that scan
  /// (objects.json, with the build's margin).
  std::size_t box_points_after = 0;
  /// Those of them with a *measured* map point within 0.1 m, whatever scan that came from: what
  /// stands in the map where a labelled object once stood. An object that passes the same place in
  /// a scan without labels counts here.
  std::size_t box_points_in_map = 0;
  /// Raw points of these scans outside every label grown by 0.1 m, and those of them whose own
  /// voxel of the map holds no measured point, so that thinning alone changes nothing.
  std::size_t outside_points = 0;
  std::size_t outside_changed = 0;
  /// The same within 40 degrees of straight ahead, where a front camera's labels are complete.
  std::size_t fov_points = 0;
  std::size_t fov_changed = 0;
};

/// Judges a map with the raw scans that went into it: every raw point is taken to the map as the
/// build did (same selection, ranges, deskewing, poses) and looked up there. In a map that was
/// built with
/// `--movable keep` nothing is removed and nothing changed, but for rounding.
/// @throws maps::InputError when the map's scans are not in the drive or no scan is labelled;
///         maps::StorageError, Cancelled.
[[nodiscard]] MapEvaluation evaluate_map(const maps::MapPackage& map, const maps::Drive& drive,
                                         const MapEvaluationOptions& options,
                                         const ProgressCallback& progress,
                                         const CancelFlag& cancel);

/// The object of `--json`: `scans`, `seconds`, `box_points {before, after, removed_share, in_map,
/// in_map_removed_share}`,
/// `outside {points, changed, changed_share, fov_points, fov_changed, fov_changed_share}`.
[[nodiscard]] std::string to_json(const MapEvaluation& evaluation);

}  // namespace stillmap::mapping

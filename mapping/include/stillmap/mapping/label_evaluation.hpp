#pragma once

#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stillmap::mapping {

/// Which truth points should not be in a map. Classes of SemanticKITTI; 0 and 1 never count.
enum class TruthClasses {
  kMoving,   ///< 252 to 259: what moved during the drive, as published
  kMovable,  ///< also what could have: 10, 11, 13, 15, 16, 18, 20, 30, 31, 32
};
[[nodiscard]] std::string_view name_of(TruthClasses classes);

/// A part of a whole.
struct Share {
  std::size_t count = 0;
  std::size_t of = 0;
  /// NaN when there is nothing to be a part of.
  [[nodiscard]] double rate() const;
};

/// How a map stands to one set of truth classes. Rates are 0 to 1, NaN where nothing could be
/// counted.
struct MapScores {
  /// DynamicMap_Benchmark: truth points within 50 m of the sensor, a map point within 0.05 m. For
  /// dynamic ones projected and filled map points are not matched, but in `plain_removed`.
  Share static_kept, dynamic_removed, plain_removed;
  double SA = 0.0, DA = 0.0, AA = 0.0, HA = 0.0;
  /// ERASOR: voxels of 0.2 m, within 0.1732 m. Here all map points count, as published.
  Share static_voxels_kept, dynamic_voxels_kept;
  double PR = 0.0, RR = 0.0, F1 = 0.0;
  /// Static truth points without a measured map point within 0.1 m; and the same for the map of the
  /// same voxels that holds everything.
  Share static_lost, static_lost_uncleaned;
  /// The first less the second.
  double static_loss = 0.0;
};

/// Static loss of one class.
struct ClassLoss {
  std::uint16_t label = 0;
  std::string name;
  Share lost, lost_uncleaned;
  double loss = 0.0;
};

/// Cells of 0.25 m of the footprints of parked objects that were removed.
struct GroundUnder {
  /// Those with ground within 0.05 m of the true height: measured or projected, and filled too.
  Share projected, filled;
  /// Those with ground, but farther from the true height.
  std::size_t wrong = 0;
};

/// The same for footprints by their distance from the path.
struct GroundUnderBand {
  /// Up to this far, and beyond the band before [m].
  double to_m = 0.0;
  GroundUnder ground;
};

/// All that is said of one kind of map.
struct MapFigures {
  /// Of `kMoving` and of `kMovable`.
  std::array<MapScores, 2> scores;
  [[nodiscard]] const MapScores& of(TruthClasses classes) const {
    return scores[classes == TruthClasses::kMoving ? 0 : 1];
  }
  /// Truth points of parked objects more than 0.3 m over true ground, and those of them without a
  /// map point of any kind within 0.1 m.
  Share parked_removed;
  /// Nothing but zeros without a true surface.
  GroundUnder ground_under;
  std::vector<GroundUnderBand> ground_bands;
  /// Static classes, as `kMovable` has them, that occur.
  std::vector<ClassLoss> losses;
};

/// How far ground is from the true surface, up or down.
struct HeightErrors {
  std::size_t points = 0;
  /// NaN without a point.
  double median_m = 0.0;
  double p95_m = 0.0;
  /// Percentiles 0 to 100 [m]; empty without a point.
  std::vector<double> percentiles_m;
};

/// Projected and filled points of a map within 25 m of the path.
struct GroundHeights {
  HeightErrors all, projected, filled;
  /// By where they lie: in footprints on one surface (or in none), and in those across a step of
  /// more than 8 cm.
  HeightErrors one_surface, across_kerb;
};

/// Ground in the Patchwork++ protocol: 40, 44, 48, 49, 60, 72 are ground, 0, 1 and 70 left out.
struct GroundScores {
  std::size_t true_positives = 0, false_positives = 0, false_negatives = 0;
  /// NaN where nothing could be counted.
  [[nodiscard]] double precision() const;
  [[nodiscard]] double recall() const;
  [[nodiscard]] double f1() const;
};

/// What is known of the ground under objects.
enum class TrueGround {
  kNone,     ///< nothing
  kLabels,   ///< labelled ground points around them: enough to tell parked objects from the road
  kSurface,  ///< the simulator's surface
};
[[nodiscard]] std::string_view name_of(TrueGround ground);

/// Seen from above, as PNG files: the scans as they were measured, and the map. Removed objects are
/// outlined, parked ones in orange, moving ones in blue with their path.
struct MapPictures {
  std::string before_png, after_png;
};

/// How a map stands to a drive whose every point is labelled.
struct LabelEvaluation {
  std::size_t scans = 0;
  /// Of these scans: judged, of no known class, left out by the build.
  std::size_t points = 0, ignored = 0, dropped = 0;
  double seconds = 0.0;
  /// By what is done: stage, seconds.
  std::vector<std::pair<std::string, double>> stage_seconds;
  double peak_rss_mib = 0.0;
  /// Whether the map was made of the drive. If not, `unthinned` and `ground` are not known, and
  /// nothing is subtracted from what a map has lost.
  bool drive_in_map = false;
  /// Drives in the map.
  std::size_t drives = 0;
  TrueGround true_ground = TrueGround::kNone;
  /// Parked objects that were removed, and moving ones.
  std::size_t parked_objects = 0, moving_objects = 0;
  /// The unthinned map: all points that the build left, where they were measured or landed.
  std::optional<MapFigures> unthinned;
  /// The package's own points, one a voxel.
  MapFigures thinned;
  /// Only with a true surface.
  std::optional<GroundHeights> heights;
  std::optional<GroundScores> ground;
  /// When asked for.
  std::optional<MapPictures> pictures;

  /// The unthinned map's figures, or the thinned one's where there is nothing else.
  [[nodiscard]] const MapFigures& figures() const { return unthinned ? *unthinned : thinned; }
};

/// Judges a map with a drive whose points carry SemanticKITTI labels.
///
/// Truth points are the drive's points that the build did not drop, taken to the map as the build
/// did. The unthinned map is what the build left of them (`MapPackage::fates`; a point that was
/// kept but whose voxel holds no measured point any more was cleaned away), projected points where
/// they landed, and of filled points and of other drives of the map what the package holds.
/// Footprints are those of the map's own objects that were parked (more exactly: not found to be
/// moving); where something drove along, other scans see the ground, which would flatter.
///
/// True ground comes from DRIVE/truth/ground.ply, as `stillmap simulate --truth` writes it. Memory:
/// below 2 GiB for 1,000 scans of 120,000 points; scans are read four times instead of being kept.
///
/// @param draw  whether `pictures` are wanted.
/// @throws maps::InputError for a drive without labels, labels that are no classes, a map without
///         the options of a build; maps::StorageError, Cancelled.
/// @see Zhang et al., "A Dynamic Points Removal Benchmark in Point Cloud
///      Maps", ITSC 2023; Lim et al., "ERASOR", RA-L 2021; Lee et al., "Patchwork++", IROS 2022.
[[nodiscard]] LabelEvaluation evaluate_with_labels(const maps::MapPackage& map,
                                                   const maps::Drive& drive, bool draw,
                                                   const ProgressCallback& progress,
                                                   const CancelFlag& cancel);

/// The object of `--json`: the figures of `classes` at the top, then `moving`, `movable`, `thinned`
/// and the rest. What could not be known is null.
[[nodiscard]] std::string to_json(const LabelEvaluation& evaluation, TruthClasses classes);

/// What a report says of itself; plain text, escaped when it is written.
struct LabelReportHeading {
  std::string map;
  std::string drive;
  TruthClasses classes = TruthClasses::kMovable;
  /// How to make it again.
  std::string command;
};

/// A page of `--report`: one HTML file that needs no other, without scripts. Scores, before and
/// after from above, static loss by class, heights of the ground under objects, times.
/// @note  The same evaluation gives the same bytes; only times and memory differ from run to run.
[[nodiscard]] std::string to_html(const LabelEvaluation& evaluation,
                                  const LabelReportHeading& heading);

}  // namespace stillmap::mapping

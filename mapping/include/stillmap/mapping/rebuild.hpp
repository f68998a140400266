#pragma once

#include <stillmap/mapping/build_units.hpp>
#include <stillmap/mapping/cleaning.hpp>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/mapping/map_patch.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/mapping/progress_lines.hpp>
#include <stillmap/mapping/rebuild_gate.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

struct RebuildOptions {
  /// At least one, as `build_map`.
  std::vector<std::filesystem::path> drives;
  /// The package to make; must not exist.
  std::filesystem::path map;
  /// Folder that keeps finished stages, on the map's file system and for this rebuild alone. Made
  /// if it is missing. It may be deleted when the rebuild is done.
  std::filesystem::path work;
  /// Its `held_back_every`, `journal_folder` and `detect_always` are set by the rebuild, and with
  /// `previous` its `register_to`, with `patch` its `follows_map`.
  MapBuildOptions build;
  /// The version that is in use, to which the new one is registered. None for a first version, and
  /// for one that is to have a frame of its own.
  std::optional<std::filesystem::path> previous;
  /// The new version is the previous one but for the tiles that the drives saw: `patch_map`. Only
  /// with `previous`. The gate judges the patch and what lies around it.
  bool patch = false;
  PatchOptions patch_options;
  /// A drive of the same streets that the map is not made from, in the frame of the drives' own
  /// poses or with a geodetic origin. It is a better judge than scans of the drives themselves,
  /// which favour a map that keeps the cars that stood there.
  std::optional<std::filesystem::path> held_back;
  /// Without such a drive: of each drive, every n-th scan stays out of the map, >= 2.
  std::size_t held_back_every = 10;
  GateLimits limits;
};

/// What came of the held-back scans in one map.
struct HeldBackAnswers {
  std::size_t queries = 0;
  /// Within 0.2 m and 1 deg, and not lost.
  std::size_t found = 0;
  std::size_t ok = 0, degraded = 0, lost = 0;
  /// `ok` and off by more than 0.5 m or 2 deg.
  std::size_t false_ok = 0;
  /// Of each query: 'o', 'd' or 'l'. The same order for all maps.
  std::string status;
};

struct RebuildResult {
  std::string digest;
  std::string keep_digest;
  /// Empty for a first version.
  std::string previous_digest;
  /// With `patch`.
  std::optional<PatchResult> patch;
  HeldBackAnswers answers;
  HeldBackAnswers keep_answers;
  std::optional<HeldBackAnswers> previous_answers;
  GateFigures figures;
  GateVerdict verdict;
  /// Points of the keep map that `static_loss` counted, and the lost ones.
  std::uint64_t static_points = 0;
  std::uint64_t static_points_lost = 0;
  /// What a person should look at.
  std::vector<std::string> warnings;
  std::uint64_t map_bytes = 0;
  /// Largest size of the work folder, measured at the end of each stage.
  std::uint64_t work_bytes = 0;
  /// By stage, each with what its last process took; and the stages that an earlier process had
  /// done.
  std::map<std::string, double> stage_seconds;
  std::vector<std::string> resumed_stages;
  double peak_rss_mib = 0.0;
};

/// How far off the priors of held-back scans are. They are drawn with this seed as in
/// `evaluate_localization`, and are the same for every map. So much a vehicle knows that was lost
/// for some seconds.
inline constexpr double kGatePriorErrorM = 1.0;
inline constexpr double kGatePriorErrorDeg = 5.0;
inline constexpr std::uint64_t kGateSeed = 1;
/// More held-back scans than this are thinned out evenly.
inline constexpr std::size_t kMostHeldBackScans = 300;

/// Makes a package that `rebuild_map` asks for, in another way than by `build_map`.
/// @param part    `map` or `keep`, as `do_rebuild_unit` takes it.
/// @param target  its place.
using PackageMaker =
    std::function<void(const std::string& part, const std::filesystem::path& target,
                       const ProgressCallback& progress)>;

/// Makes a new version of a map and judges it.
///
/// The map is built; a second one of the same scans in which everything stays (`keep`: nothing
/// projected, deleted, cleaned or filled) is built on the same first pass; the held-back scans are
/// looked for in both and in the previous version; the maps are compared; the gate decides. With
/// `patch` the map of the drives is put into the previous version before it is judged. Each
/// stage that is done is remembered in the work folder, so that the same call goes on with the next
/// one after a kill, to the same map and figures. Work of another call there is thrown away, with a
/// warning. The map appears at its place when all is done, whatever the verdict.
/// @throws std::invalid_argument (options), maps::InputError, maps::StorageError, Cancelled. What
/// was done before stays in the work folder.
/// @param make_package  of the same bytes as `build_map` makes it, by units; none: `build_map`.
RebuildResult rebuild_map(const RebuildOptions& options, const ProgressCallback& progress,
                          const CancelFlag& cancel, const CleanerFactory& make_cleaner = {},
                          const PackageMaker& make_package = {});

/// Does one unit of a package of a rebuild, as `do_unit`. Both packages use one folder of units, so
/// that the first pass is done once.
/// @param part  `map`, or `keep` once `map` is made.
/// @throws as `do_unit`; std::invalid_argument for another part.
MapBuildResult do_rebuild_unit(const RebuildOptions& options, std::string_view part,
                               const BuildUnit& unit, std::size_t units,
                               const ProgressCallback& progress, const CancelFlag& cancel);

/// The stages that `rebuild_map` tells of, in order.
[[nodiscard]] std::vector<StageShare> rebuild_stages(const RebuildOptions& options);

/// What a rebuild needs on the disk at most, roughly.
struct RebuildEstimate {
  std::uint64_t scans = 0;
  /// By the mean of some scans.
  std::uint64_t points = 0;
  std::uint64_t package_bytes = 0;
  /// Beside the package, while it works.
  std::uint64_t work_bytes = 0;
  [[nodiscard]] std::uint64_t bytes() const { return package_bytes + work_bytes; }
};

/// Reads a few scans. @throws as `build_map`.
[[nodiscard]] RebuildEstimate estimate_rebuild(const RebuildOptions& options);
/// The same from numbers.
[[nodiscard]] RebuildEstimate estimate_rebuild(std::uint64_t scans, std::uint64_t points,
                                               double voxel_size_m);

/// The object of `--json`, without the keys that only the program knows (`version`); keys as in
/// mapping/rebuild.md. NaN becomes null.
[[nodiscard]] std::string to_json(const RebuildResult& result, const RebuildOptions& options);
[[nodiscard]] std::string to_json(const RebuildEstimate& estimate);

}  // namespace stillmap::mapping

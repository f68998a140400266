#pragma once

#include <stillmap/mapping/map_build.hpp>
#include <stillmap/mapping/progress.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// A part of a build that a process of its own does, on this machine or on another one that sees
/// the same folders (mapping/units.md).
struct BuildUnit {
  enum class Kind : std::uint8_t {
    kPoses,   ///< Of all scans. One job: odometry, loops and graph see all drives.
    kSurvey,  ///< A share of the scans is surveyed.
    kFuse,    ///< Objects and ground of all scans.
    kFinish,  ///< The tiles of a share of the regions, from the scans that see them.
    kMerge,   ///< The package from what the others wrote.
  };
  Kind kind = Kind::kPoses;
  /// Of a survey or finish unit, in [1, units].
  std::size_t number = 1;

  bool operator==(const BuildUnit&) const = default;
};

inline constexpr std::size_t kMostUnits = 1000;

/// `poses`, `survey:3`, `fuse`, `finish:3`, `merge`.
[[nodiscard]] std::string name_of(const BuildUnit& unit);
/// @param text  names with commas between them. @param units  shares of survey and finish.
/// @throws std::invalid_argument naming what is none.
[[nodiscard]] std::vector<BuildUnit> units_from(std::string_view text, std::size_t units);

/// All units of a build. Those of one step may be done in any order and at the same time, once
/// those of the step before have ended.
/// @param units  shares of survey and finish, in [1, kMostUnits].
[[nodiscard]] std::vector<std::vector<BuildUnit>> unit_steps(std::size_t units);

/// Where the units of a build write down what they have done, beside the map; `merge` removes it.
[[nodiscard]] std::filesystem::path units_folder(const std::filesystem::path& target);

/// @throws std::invalid_argument for options or a number of shares that units cannot build with.
void require_usable_by_units(const MapBuildOptions& options, std::size_t units);

/// Does one unit of the build that `build_map` does in one process: the map has the same bytes,
/// whatever the number of units, and whoever was killed on the way. A unit that is done already is
/// not done again. One that was killed is given again: a survey goes on where it was, the others
/// begin anew.
/// @param options  the same for all units, but for `threads`; with a cleaning method of ours. Its
///                 `journal_folder` is used in place of `units_folder`, and stays.
/// @param units    the same for all.
/// @return of `merge` what the build did, also where the map is there already; of the other units a
///         result without a digest, with warnings.
/// @throws as `build_map`; maps::InputError where a unit before this one is not done, or was done
///         for other scans, options, or by another program.
MapBuildResult do_unit(const std::vector<std::filesystem::path>& drives,
                       const std::filesystem::path& target, const MapBuildOptions& options,
                       const BuildUnit& unit, std::size_t units, const ProgressCallback& progress,
                       const CancelFlag& cancel);

}  // namespace stillmap::mapping

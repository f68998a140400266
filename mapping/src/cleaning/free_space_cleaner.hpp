#pragma once

#include "cleaning/free_evidence.hpp"

#include <stillmap/mapping/cleaning.hpp>

#include <Eigen/Geometry>

#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// How far around an area points must be given, so that the answers within it are those of the
/// whole map [m].
[[nodiscard]] double free_space_rim_m(double voxel_size_m);

/// Finds what moved in a part of a map: what some scans hit and others saw through.
///
/// In the spirit of DUFOMap and Removert, and careful: a cell goes only when views in a row from
/// several places saw it free with a guard around it for pose errors and beam width, when these are
/// many against the views that hit it or saw something close to it, and when what lies around it
/// goes too (`find_free_evidence`, `moved_cells`). Ground never goes, nor what is lower than a
/// kerb or higher than a lorry over it.
/// @param points     of the area and of `free_space_rim_m` around it, e.g. a tile and its rim.
/// @param area       x, y that answers are wanted for; flags of points outside of it mean nothing.
/// @param views      of all scans.
/// @param keyframes  of `views`.
/// @return a flag a point, 1 = goes. Same input, same bits; the same for any division of a map into
/// areas.
/// @see Duberg, Zhang, Jia, Jensfelt, "DUFOMap: Efficient Dynamic Awareness Mapping", RA-L 2024
/// (once surely free, whatever hits it moved): we count, since one view through a fence is sure and
/// wrong. Kim, Kim, "Remove, then Revert", IROS 2020 (visibility in range images).
[[nodiscard]] std::vector<std::uint8_t> moved_by_free_space(const CleaningPoints& points,
                                                            const Eigen::AlignedBox2f& area,
                                                            const PosedViews& views,
                                                            std::span<const Keyframe> keyframes);

/// `moved_by_free_space` over a whole map, tile by tile.
class FreeSpaceCleaner final : public Cleaner {
 public:
  /// @param scratch  folder for the views of the scans, some 0.1 MiB a keyframe while it works.
  /// @param threads  0 = all cores.
  FreeSpaceCleaner(std::filesystem::path scratch, int threads)
      : scratch_(std::move(scratch)), threads_(threads) {}

  [[nodiscard]] std::vector<std::uint8_t> moved(const CleaningPoints& points,
                                                const ScanSource& scans,
                                                const ProgressCallback& progress,
                                                const CancelFlag& cancel) const override;

 private:
  std::filesystem::path scratch_;
  int threads_;
};

}  // namespace stillmap::mapping

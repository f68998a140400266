#pragma once

#include "ground/ground_cells.hpp"
#include "ground/ground_footprint.hpp"
#include "ground/ground_piles.hpp"
#include "ground/ground_sheets.hpp"

#include <stillmap/mapping/ground.hpp>
#include <stillmap/mapping/ground_below.hpp>

#include <Eigen/Geometry>

#include <filesystem>
#include <optional>
#include <span>
#include <utility>

namespace stillmap::mapping {

/// The ground of all scans of all drives, as one height field with steps in the local frame (the
/// map frame less the map's origin).
class FusedGround {
 public:
  /// @param scratch  existing folder for what does not stay in memory; empty: all stays.
  explicit FusedGround(const std::filesystem::path& scratch = {})
      : scratch_(scratch), piles_(scratch), sheets_(scratch) {}

  /// Serial, in the scans' order; what a scan adds is a few thousand cells.
  /// @throws std::logic_error after `finish`.
  void add(const GroundCells& ground);
  /// Gives memory back; what is looked at next comes from the file. To be called every few hundred
  /// scans. Safe beside threads that ask for the ground.
  void rest() const {
    piles_.rest();
    sheets_.rest();
  }

  /// Ends the adding. Once only.
  /// @param footprints  of objects that stood still; under them kerbs go on, and what was measured
  ///                    in boxes is looked at again.
  /// @throws std::logic_error the second time.
  void finish(std::span<const GroundFootprint> footprints);

  /// The ground at a place.
  /// @param x, y  local frame [m].
  /// @param z     height of who asks: where roads lie over each other he gets the one under him,
  ///              the highest that is at most half a metre above. Without it, the one that was seen
  ///              best, thus most likely driven on.
  /// @return nothing where no ground was measured within some 8 m (in its block of 4 m or the next
  /// ones), and before `finish`.
  /// @note Safe from several threads once finished.
  [[nodiscard]] std::optional<GroundSurface::Sample> at(
      double x, double y, std::optional<double> z = std::nullopt) const;

  [[nodiscard]] const GroundSheets& sheets() const { return sheets_; }
  /// Takes over what another one finished, or a part of it, instead of adding and finishing.
  void take(GroundSheets sheets) {
    sheets_ = std::move(sheets);
    finished_ = true;
  }

 private:
  std::filesystem::path scratch_;
  GroundPiles piles_;
  GroundSheets sheets_;
  bool finished_ = false;
};

/// The fused ground as one scan sees it: down is along the map's z, however the sensor is tilted.
class BelowFused final : public GroundBelow {
 public:
  /// @param ground  finished; must outlive this.
  BelowFused(const FusedGround& ground, const Eigen::Isometry3d& T_local_lidar)
      : ground_(ground), T_local_lidar_(T_local_lidar), T_lidar_local_(T_local_lidar.inverse()) {}
  [[nodiscard]] std::optional<Foot> below(const Eigen::Vector3f& p) const override;

 private:
  const FusedGround& ground_;
  Eigen::Isometry3d T_local_lidar_;
  Eigen::Isometry3d T_lidar_local_;
};

}  // namespace stillmap::mapping

#pragma once

#include "views/range_view.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// The range views of scans with their poses, in the order of the scans. Safe from several threads.
struct PosedViews {
  /// One a scan; "local" as in `PosedScan`.
  std::vector<Eigen::Isometry3d> T_local_lidar;
  /// The view of a scan by ordinal.
  std::function<std::shared_ptr<const RangeView>(std::size_t scan)> read;
};

/// Ordinals of the scans whose views are looked at: one every 0.7 m or 10 degrees, and one every
/// 20 scans of a vehicle that stands, so that each place is seen from enough places and no more.
[[nodiscard]] std::vector<std::size_t> select_keyframes(
    const std::vector<Eigen::Isometry3d>& T_local_lidar);

/// What all views say about a cell.
struct SightCounts {
  std::uint16_t free = 0;
  std::uint16_t hit = 0;
  std::uint16_t mixed = 0;
  std::uint16_t hidden = 0;
  /// Most views in a row, others than free and hit left out, that saw it free.
  std::uint16_t free_run = 0;
  /// Its last views, the same.
  std::uint16_t open_run = 0;
};

/// @param positions  M points, local frame [m]. @param radius_m  of the cell around each.
/// @param keyframes  ordinals in `views`, increasing.
/// @return M counts. Same input, same bits.
[[nodiscard]] std::vector<SightCounts> count_sights(std::span<const Eigen::Vector3f> positions,
                                                    float radius_m, const PosedViews& views,
                                                    std::span<const std::size_t> keyframes);

}  // namespace stillmap::mapping

#pragma once

#include <stillmap/maps/scan.hpp>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping::loam {

/// The points of a scan by the laser that took them: the paper's *scans* of a *sweep*.
struct Rings {
  /// Positions in the cloud, ring by ring, each in the order in which the sensor turned.
  std::vector<std::uint32_t> points;
  /// Where each ring starts in `points`, then the end: R + 1 numbers, or none for no rings.
  std::vector<std::uint32_t> starts;

  [[nodiscard]] std::size_t size() const { return starts.empty() ? 0 : starts.size() - 1; }
  [[nodiscard]] std::span<const std::uint32_t> ring(std::size_t r) const {
    return std::span(points).subspan(starts[r], starts[r + 1] - starts[r]);
  }
};

/// Rings of a spinning sensor, which no layout names.
///
/// First by order: KITTI's files and the simulator's list points ring by ring, so the azimuth goes
/// round once a ring, and at one azimuth the elevation jumps. Then by elevation: where rings are
/// narrow beside the gaps between them, each is a peak of the histogram (Ouster, Velodyne VLP).
/// Elevation alone does not part an HDL-64E, whose lasers do not sit in one point.
///
/// @param scan  any order; points that are not finite or nearer than `kMinRangeM` are left out.
/// @return no rings for a scan of too few points to tell.
/// @throws maps::InputError naming the scan's source where points are many and rings are none.
[[nodiscard]] Rings find_rings(const maps::Scan& scan);

/// Nearer points are the vehicle's own [m].
inline constexpr float kMinRangeM = 2.0F;
/// Farther points are too sparse to be a surface [m].
inline constexpr float kMaxRangeM = 100.0F;

}  // namespace stillmap::mapping::loam

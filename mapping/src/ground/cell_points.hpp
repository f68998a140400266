#pragma once

#include "ground/concentric_zones.hpp"
#include "ground/height_grid.hpp"
#include "ground/seed_plane.hpp"

#include <stillmap/maps/scan.hpp>

#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// The cells of the height grid in the order of their patches, so that the points of a patch lie
/// beside each other once they are sorted by cell. A cell belongs to the patch of its centre, which
/// saves an arctangent a point; the borders of patches follow the cells.
struct PatchLayout {
  static const PatchLayout& instance();

  std::vector<int> slot_of_cell;
  /// Patch of each cell, or -1.
  std::vector<int> patch_of_cell;
  /// Slots of patch p: first_slot[p] to first_slot[p + 1]; the last ones belong to no patch.
  std::vector<int> first_slot;
  /// All cells by the range of their centres.
  std::vector<int> near_to_far;
  /// Range of each cell's centre [m].
  std::vector<float> range_m;
};

struct CellPoint {
  float x, y, z;
  /// In the cloud it came from.
  std::uint32_t index;
};

/// The points of a cloud that lie within the height grid, sorted by patch and cell.
class CellPoints {
 public:
  /// @param left_out  N flags of points not to take, or empty.
  CellPoints(const maps::PointCloud& cloud, const std::vector<std::uint8_t>& left_out);

  /// Subtracts the plane's height from every z.
  void level(const SeedPlane& plane);

  [[nodiscard]] std::span<const CellPoint> of_cell(int cell) const {
    const int slot = layout_->slot_of_cell[static_cast<std::size_t>(cell)];
    return between(slot, slot + 1);
  }
  [[nodiscard]] std::span<const CellPoint> of_patch(int patch) const {
    const auto p = static_cast<std::size_t>(patch);
    return between(layout_->first_slot[p], layout_->first_slot[p + 1]);
  }
  [[nodiscard]] std::span<const CellPoint> all() const { return points_; }
  /// Occupied cells from near to far.
  [[nodiscard]] const std::vector<int>& near_to_far() const { return occupied_; }

 private:
  [[nodiscard]] std::span<const CellPoint> between(int slot, int end_slot) const {
    const int first = first_[static_cast<std::size_t>(slot)];
    const int last = first_[static_cast<std::size_t>(end_slot)];
    return {points_.data() + first, static_cast<std::size_t>(last - first)};
  }

  const PatchLayout* layout_;
  std::vector<int> first_;
  std::vector<CellPoint> points_;
  std::vector<int> occupied_;
};

}  // namespace stillmap::mapping

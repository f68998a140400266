#include "detection/bev_overlap.hpp"

#include <stillmap/maps/cell_table.hpp>
#include <stillmap/maps/median.hpp>

#include "fusion/box_frames.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace stillmap::mapping {

namespace {

double radius(const maps::Box& box) { return std::hypot(box.size_m.x(), box.size_m.y()) / 2.0; }

/// Boxes kept so far by square cells of the ground plane, so that a box meets only those nearby.
class KeptBoxes {
 public:
  /// @param boxes  all that may come.
  explicit KeptBoxes(const std::vector<maps::Box>& boxes) {
    std::vector<double> radii;
    for (const maps::Box& box : boxes) radii.push_back(radius(box));
    if (radii.empty()) return;
    // Most boxes lie in at most four cells, and none in more than 17 x 17.
    cell_m_ = std::max(2.0 * maps::median(radii), std::ranges::max(radii) / 8.0);
    if (!(cell_m_ > 0.0)) cell_m_ = 1.0;
  }

  /// Whether the IoU with one that is kept is larger.
  [[nodiscard]] bool overlap(const maps::Box& box, double most_iou) const {
    const Square own = square_of(box);
    bool found = false;
    for_each_cell(own, [&](const Cell& cell) {
      // Cells 2^32 apart share their numbers; boxes of those are too far away to overlap.
      const auto* numbers = cells_.find(maps::plane_cell_key(cell.first, cell.second));
      if (found || numbers == nullptr) return;
      found = std::ranges::any_of(*numbers, [&](std::size_t number) {
        const Kept& other = kept_[number];
        // Two squares share a rectangle of cells: the pair is looked at in the first of them.
        return cell == std::pair(std::max(own.low.first, other.square.low.first),
                                 std::max(own.low.second, other.square.low.second)) &&
               overlap(box, own, other, most_iou);
      });
    });
    return found;
  }
  void add(maps::Box box) {
    const Square square = square_of(box);
    for_each_cell(square, [&](const Cell& cell) {
      cells_[maps::plane_cell_key(cell.first, cell.second)].push_back(kept_.size());
    });
    kept_.push_back({std::move(box), square});
  }
  [[nodiscard]] std::vector<maps::Box> take() {
    std::vector<maps::Box> out;
    for (Kept& kept : kept_) out.push_back(std::move(kept.box));
    return out;
  }

 private:
  using Cell = std::pair<std::int64_t, std::int64_t>;
  /// The circle around a box, and the cells that the square around that touches.
  struct Square {
    double radius = 0.0;
    Cell low, high;
  };
  struct Kept {
    maps::Box box;
    Square square;
  };

  [[nodiscard]] Square square_of(const maps::Box& box) const {
    const double r = radius(box);
    return {r,
            {index(box.centre.x() - r), index(box.centre.y() - r)},
            {index(box.centre.x() + r), index(box.centre.y() + r)}};
  }
  /// Ascends with x, and so finds the same cell for the same x, wherever it is.
  [[nodiscard]] std::int64_t index(double x) const {
    constexpr double kFar = 0x1p40;
    const double cell = std::floor(x / cell_m_);
    return !(cell > -kFar) ? -(std::int64_t{1} << 40)
                           : static_cast<std::int64_t>(std::min(cell, kFar));
  }
  template <typename F>
  static void for_each_cell(const Square& square, F&& work) {
    for (std::int64_t x = square.low.first; x <= square.high.first; ++x) {
      for (std::int64_t y = square.low.second; y <= square.high.second; ++y) work(Cell{x, y});
    }
  }
  [[nodiscard]] static bool overlap(const maps::Box& box, const Square& own, const Kept& other,
                                    double most_iou) {
    const double reach = own.radius + other.square.radius;
    return (box.centre - other.box.centre).head<2>().squaredNorm() < reach * reach &&
           overlap_of(box, other.box).of_joint > most_iou;
  }

  double cell_m_ = 1.0;
  std::vector<Kept> kept_;
  maps::CellMap<std::vector<std::size_t>> cells_;
};

}  // namespace

std::vector<maps::Box> suppress_overlaps(std::vector<maps::Box> boxes, double most_iou) {
  std::stable_sort(boxes.begin(), boxes.end(),
                   [](const maps::Box& a, const maps::Box& b) { return a.score > b.score; });
  KeptBoxes kept(boxes);
  for (maps::Box& box : boxes) {
    if (!kept.overlap(box, most_iou)) kept.add(std::move(box));
  }
  return kept.take();
}

}  // namespace stillmap::mapping

#pragma once

#include <Eigen/Core>

#include <stillmap/maps/cell_table.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// Points that a build took out of a map, each waiting to meet one that is still in it.
///
/// They are few, the map's points are many and come as a stream; so it is the removed ones that are
/// kept and sorted into cells, and every map point is looked up among them. Collect with `add`,
/// call `sort` once, stream the map through `meet`, then read `points`.
///
/// Memory: 16 bytes a point and some 6 for its cell; 20 more a point while sorting.
class RemovedPoints {
 public:
  /// Distances that are told apart [m]: DynamicMap_Benchmark's, and ours.
  static constexpr float kSameM = 0.05F;
  static constexpr float kNearM = 0.1F;

  struct Point {
    Eigen::Vector3f position = Eigen::Vector3f::Zero();
    /// The caller's.
    std::uint16_t tag = 0;
    /// What was met so far, as bits.
    std::uint16_t met = 0;
  };
  enum Met : std::uint16_t {
    kMeasuredSame = 1,  ///< a measured point within kSameM
    kMeasuredNear = 2,
    kAnySame = 4,  ///< any point, projected and filled ones too
    kAnyNear = 8,
    kAll = 15,
  };

  /// @param position  finite, within 100 km of the origin [m].
  void add(const Eigen::Vector3f& position, std::uint16_t tag) {
    points_.push_back({position, tag});
  }
  void sort();

  /// @param position  of a map point, as above.
  void meet(const Eigen::Vector3f& position, bool measured);

  [[nodiscard]] std::span<const Point> points() const { return points_; }

 private:
  using Cell = std::array<std::int32_t, 3>;
  struct Range {
    std::uint32_t begin = 0;
    /// Those from here on have met all that there is.
    std::uint32_t end = 0;
  };

  [[nodiscard]] bool may_be_near(const Cell& cell) const;
  void mark_near(const Cell& cell);
  void meet_in(Range& range, const Eigen::Vector3f& position, std::uint16_t same,
               std::uint16_t near);

  std::vector<Point> points_;
  maps::CellMap<Range> cells_;
  /// A bit for each block of cells by hash, set where a removed point is in reach: most map points
  /// are far from all of them, and this fits into a cache.
  std::vector<std::uint64_t> reach_;
};

}  // namespace stillmap::mapping

#pragma once

#include <Eigen/Core>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace stillmap::mapping {

/// Points sorted into cubic cells, to find what lies near a place. 20 to 28 bytes a point; building
/// takes another 28 for a while. Queries are safe from several threads.
class PointCells {
 public:
  struct Neighbour {
    /// Index into the points as they were given.
    std::uint32_t point = 0;
    double squared_distance_m2 = 0.0;
  };
  /// Points [begin, end) in the order of in_cell_order().
  struct Range {
    std::uint32_t begin = 0;
    std::uint32_t end = 0;
  };

  /// @param points  fewer than 2^32 - 1, finite, within 2^20 cells of the origin on each axis [m].
  /// @param cell_m  edge of a cell, > 0.
  /// @throws std::invalid_argument when a bound is broken.
  PointCells(std::vector<Eigen::Vector3f> points, double cell_m);

  /// The nearest point within `radius_m` of p [m], the first of several. Fast up to a radius of one
  /// cell.
  [[nodiscard]] std::optional<Neighbour> nearest(const Eigen::Vector3f& p, double radius_m) const;
  /// Whether a point lies within `radius_m` of p [m].
  [[nodiscard]] bool any_within(const Eigen::Vector3f& p, double radius_m) const;

  [[nodiscard]] std::size_t cells() const { return begins_.empty() ? 0 : begins_.size() - 1; }
  /// Cells in the order of their place, 0 <= cell < cells().
  [[nodiscard]] Range cell(std::size_t cell) const { return {begins_[cell], begins_[cell + 1]}; }
  /// A cell and the 26 around it, empty where there is none: everything within the edge of a cell
  /// of any point in it.
  [[nodiscard]] std::array<Range, 27> around(std::size_t cell) const;
  /// Sorted by cell, in a cell as they were given.
  [[nodiscard]] const std::vector<Eigen::Vector3f>& in_cell_order() const { return points_; }
  /// Where each of in_cell_order() was in the points as they were given.
  [[nodiscard]] const std::vector<std::uint32_t>& given_index() const { return given_index_; }

 private:
  using Cell = std::array<std::int64_t, 3>;

  [[nodiscard]] Cell cell_of(const Eigen::Vector3f& p) const;
  void sort_points(std::vector<Eigen::Vector3f> points);
  void fill_table();
  [[nodiscard]] std::size_t slot_of(std::uint64_t key) const;
  [[nodiscard]] Range find(const Cell& cell) const;
  /// Lowers `best` to the nearest point of a cell; returns at once when `any` is enough.
  void search_cell(const Cell& cell, const Eigen::Vector3d& p, bool any,
                   std::optional<Neighbour>& best, double& limit_m2) const;
  [[nodiscard]] std::optional<Neighbour> search(const Eigen::Vector3f& p, double radius_m,
                                                bool any) const;

  double cell_m_;
  double inverse_cell_;
  std::vector<Eigen::Vector3f> points_;
  std::vector<std::uint32_t> given_index_;
  /// First point of each cell, then the number of points.
  std::vector<std::uint32_t> begins_;
  /// Open addressing: a cell's number + 1, or 0.
  std::vector<std::uint32_t> table_;
  unsigned table_shift_ = 64;
};

}  // namespace stillmap::mapping

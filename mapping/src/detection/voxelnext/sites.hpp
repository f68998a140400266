#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace stillmap::mapping {

/// Three numbers, one for each axis: cells of a grid, a kernel's size, a stride, a cell.
struct Triple {
  int z = 0;
  int y = 0;
  int x = 0;
  friend bool operator==(const Triple&, const Triple&) = default;
};

/// The active cells of a sparse 3D grid (2D: one cell in z), numbered in order of (y, z, x).
///
/// A bit for each cell, and for each word of bits the number of active cells before it, so that a
/// cell's number is two look-ups and a count of bits, and needs no hash. Cells of a drive lie on
/// surfaces, so the neighbours of one are few numbers apart in y-major order: a convolution reads
/// them from the cache.
class SiteSet {
 public:
  static constexpr std::uint32_t kNone = 0xFFFFFFFFU;
  /// Active cells of one line along x; `words` is the line's first word.
  struct Line {
    int z = 0;
    int y = 0;
    std::uint32_t begin = 0;
    std::uint32_t end = 0;
  };

  /// Of numbers of cells.
  struct Range {
    std::uint32_t begin = 0;
    std::uint32_t end = 0;
  };

  SiteSet() = default;
  /// @throws std::invalid_argument for a grid without cells or with more than 2^29 of them.
  explicit SiteSet(const Triple& grid);

  /// Activates a cell, inside the grid. Numbers hold only after `number_sites`.
  void mark(const Triple& cell) {
    bits_[word_of(cell)] |= bit_of(cell.x);
    is_marked_[line_of(cell.z, cell.y)] = 1;
  }
  /// Activates cells of a line along x inside the grid. @param words  `words_in_line` of them.
  void mark_line(int z, int y, const std::vector<std::uint64_t>& words) {
    std::uint64_t* line = &bits_[first_word(z, y)];
    for (std::size_t k = 0; k < words_in_line_; ++k) line[k] |= words[k];
    is_marked_[line_of(z, y)] = 1;
  }
  /// Ends marking.
  void number_sites();

  [[nodiscard]] const Triple& grid() const { return grid_; }
  [[nodiscard]] std::size_t size() const { return sites_.size(); }
  /// Cell of a number.
  [[nodiscard]] const Triple& operator[](std::size_t site) const { return sites_[site]; }
  [[nodiscard]] const std::vector<Line>& lines() const { return lines_; }
  [[nodiscard]] bool contains(const Triple& cell) const {
    return cell.z >= 0 && cell.z < grid_.z && cell.y >= 0 && cell.y < grid_.y && cell.x >= 0 &&
           cell.x < grid_.x;
  }
  /// Number of a cell; kNone when it is not active or outside.
  [[nodiscard]] std::uint32_t find(const Triple& cell) const;

  /// Active cells of a line along x, inside the grid.
  [[nodiscard]] Range line(int z, int y) const {
    const std::size_t line = line_of(z, y);
    return {line_begin_[line], line_begin_[line + 1]};
  }
  [[nodiscard]] std::size_t words_in_line() const { return words_in_line_; }

 private:
  [[nodiscard]] std::size_t line_of(int z, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(grid_.z) +
           static_cast<std::size_t>(z);
  }
  [[nodiscard]] std::size_t first_word(int z, int y) const {
    return line_of(z, y) * words_in_line_;
  }
  [[nodiscard]] std::size_t word_of(const Triple& cell) const {
    return first_word(cell.z, cell.y) + static_cast<std::size_t>(cell.x) / 64;
  }
  [[nodiscard]] static std::uint64_t bit_of(int x) {
    return std::uint64_t{1} << (static_cast<unsigned>(x) % 64U);
  }

  Triple grid_;
  std::size_t words_in_line_ = 0;
  std::vector<std::uint64_t> bits_;
  /// By line: whether it may have active cells.
  std::vector<std::uint8_t> is_marked_;
  /// By line: active cells before it; at the end all.
  std::vector<std::uint32_t> line_begin_;
  /// Active cells before each word of the marked lines.
  std::unique_ptr<std::uint32_t[]> before_;
  std::vector<Triple> sites_;
  std::vector<Line> lines_;
};

}  // namespace stillmap::mapping

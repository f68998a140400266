#pragma once

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/map_tile.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// 8 bits each.
struct Colour {
  std::uint8_t red = 0, green = 0, blue = 0;
  bool operator==(const Colour&) const = default;
};

/// A picture from above: x to the right, y up, the highest point of each pixel coloured by its
/// height (low blue, high yellow), lines on top of it. Pixels without a point stay dark.
class TopView {
 public:
  /// @param min, max      what it shows [m]; max > min in both.
  /// @param longest_side  pixels of the longer side, in [16, 8192].
  /// @throws std::invalid_argument when a bound is broken.
  TopView(const Eigen::Vector2d& min, const Eigen::Vector2d& max, int longest_side);

  /// A map's preview: all of some tiles, 1600 pixels along its longer side.
  /// @param tiles  at least one.
  static TopView of_tiles(const std::vector<maps::TileId>& tiles);

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }

  /// Points outside of the picture are left out.
  void add_point(const Eigen::Vector3d& p);
  void add_line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, Colour colour);
  /// Outline of a box given in a frame `b`, drawn in the picture's frame `a`.
  void add_box(const maps::Box& box, const Eigen::Isometry3d& T_a_b, Colour colour);

  /// Rows from the top, heights mapped between their 2nd and 98th percentile.
  [[nodiscard]] std::vector<Colour> render() const;
  /// The bytes of a PNG file.
  [[nodiscard]] std::string png() const;
  /// @throws maps::StorageError naming the file.
  void write_png(const std::filesystem::path& file) const;

 private:
  struct Line {
    std::array<int, 2> from, to;
    Colour colour;
  };

  void draw(const Line& line, std::vector<Colour>& image) const;
  [[nodiscard]] std::array<int, 2> pixel_of(const Eigen::Vector2d& p) const;
  [[nodiscard]] bool is_inside(const std::array<int, 2>& pixel) const {
    return pixel[0] >= 0 && pixel[1] >= 0 && pixel[0] < width_ && pixel[1] < height_;
  }
  [[nodiscard]] std::size_t index_of(const std::array<int, 2>& pixel) const {
    return static_cast<std::size_t>(pixel[1]) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(pixel[0]);
  }

  Eigen::Vector2d min_;
  double pixels_per_m_;
  int width_;
  int height_;
  /// Highest point of each pixel, NaN without one.
  std::vector<float> tops_;
  std::vector<Line> lines_;
};

}  // namespace stillmap::mapping

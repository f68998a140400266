#pragma once

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

namespace stillmap::mapping {

/// Ground as triangles, to ask for its height.
class GroundMesh {
 public:
  using Triangle = std::array<std::uint32_t, 3>;

  /// @param vertices   finite [m], within 100 km of the origin and 50 km of each other.
  /// @param triangles  indices of vertices.
  /// @throws std::invalid_argument when a bound is broken.
  GroundMesh(std::vector<Eigen::Vector3f> vertices, std::vector<Triangle> triangles);

  /// Height of the highest triangle over or under a place [m]: lane markings are sheets on the
  /// road. Nothing where there is none.
  [[nodiscard]] std::optional<double> height(double x, double y) const;

  [[nodiscard]] std::size_t triangles() const { return triangles_.size(); }

 private:
  [[nodiscard]] std::optional<double> height_on(const Triangle& triangle, double x, double y) const;
  [[nodiscard]] std::array<std::int64_t, 2> cell_of(double x, double y) const;
  template <typename Visit>
  void for_each_cell(const Triangle& triangle, const Visit& visit) const;
  void sort_into_cells();

  std::vector<Eigen::Vector3f> vertices_;
  std::vector<Triangle> triangles_;
  Eigen::Vector2d min_ = Eigen::Vector2d::Zero();
  std::int64_t columns_ = 0;
  std::int64_t rows_ = 0;
  /// Of each cell the first of its entries in `members_`, then their number.
  std::vector<std::uint32_t> begins_;
  std::vector<std::uint32_t> members_;
};

/// Reads `truth/ground.ply` as the simulator writes it: little endian, x y z as float, triangles of
/// int with an int each.
/// @throws maps::InputError naming the file, what was found and what was expected, when the header,
/// the size or an index is another; maps::StorageError when it cannot be read.
[[nodiscard]] GroundMesh read_ground_mesh(const std::filesystem::path& file);

}  // namespace stillmap::mapping

#pragma once

#include <Eigen/Core>

#include <array>
#include <filesystem>
#include <optional>
#include <unordered_map>
#include <vector>

namespace stillmap::test {

/// The true ground of a simulated drive, its `truth/ground.ply`: triangles in the map frame.
class TruthGround {
 public:
  /// Vertices are float32 x, y, z, faces a uchar 3 with three int32, then an int32 label, as the
  /// simulator writes them.
  /// @throws maps::InputError for any other layout, a short file or an index out of range.
  [[nodiscard]] static TruthGround read(const std::filesystem::path& ply_file);

  /// The height [m] straight above or below a place of the map frame, of several (a bridge) the one
  /// nearest to its z; nothing where no triangle is.
  [[nodiscard]] std::optional<double> height_at(const Eigen::Vector3d& p_map) const;

 private:
  void add_to_cells(int triangle);

  std::vector<Eigen::Vector3f> vertices_;
  std::vector<std::array<int, 3>> triangles_;
  /// Triangles by the 2 m cells that their bounds touch.
  std::unordered_map<long long, std::vector<int>> cells_;
};

}  // namespace stillmap::test

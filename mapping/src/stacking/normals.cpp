#include "stacking/normals.hpp"

#include <stillmap/maps/cell_table.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

constexpr float kNormalCellM = 0.2F;
constexpr std::uint32_t kLeastPoints = 6;

struct Moments {
  std::uint32_t count = 0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();

  void operator+=(const Moments& other) {
    count += other.count;
    sum += other.sum;
    squares += other.squares;
  }
};

using Cell = Eigen::Array3i;

std::uint64_t normal_cell_key(const Cell& cell) {
  return maps::signed_cell_key(cell.x(), cell.y(), cell.z());
}

class NormalCells {
 public:
  /// Points are counted from the first one, so that squares keep their digits.
  explicit NormalCells(const std::vector<Eigen::Vector3f>& positions) {
    for (const Eigen::Vector3f& p : positions) {
      Moments& cell = cells_[normal_cell_key(cell_of(p))];
      const Eigen::Vector3d q = (p - positions.front()).cast<double>();
      ++cell.count;
      cell.sum += q;
      cell.squares += q * q.transpose();
    }
  }

  [[nodiscard]] static Cell cell_of(const Eigen::Vector3f& p) {
    return (p / kNormalCellM).array().floor().cast<int>();
  }

  [[nodiscard]] Moments around(const Cell& cell) const {
    Moments all;
    for (int step = 0; step < 27; ++step) {
      const Cell offset(step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1);
      if (const Moments* found = cells_.find(normal_cell_key(cell + offset))) all += *found;
    }
    return all;
  }

 private:
  maps::CellMap<Moments> cells_;
};

SurfaceNormal normal_of(const Moments& m) {
  if (m.count < kLeastPoints) return {};
  const Eigen::Vector3d mean = m.sum / m.count;
  const Eigen::Matrix3d covariance = m.squares / m.count - mean * mean.transpose();
  const maps::SymmetricEigen<3> eigen = maps::eigen_directly_of(covariance);
  const Eigen::Vector3d values = eigen.values.cwiseMax(0.0);
  // A line has no normal: its middle extent is that of the noise [m^2].
  if (!(values[1] > 1e-4)) return {};
  const double planarity = (values[1] - values[0]) / values[1];
  return {eigen.vectors.col(0).cast<float>(),
          static_cast<std::uint8_t>(std::lround(255.0 * planarity))};
}

}  // namespace

std::vector<SurfaceNormal> estimate_normals(const std::vector<Eigen::Vector3f>& positions,
                                            const std::vector<Eigen::Vector3f>& seen_from) {
  std::vector<SurfaceNormal> normals(positions.size());
  if (positions.empty()) return normals;
  const NormalCells cells(positions);
  maps::CellMap<SurfaceNormal> of_cell;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const Cell cell = NormalCells::cell_of(positions[i]);
    const auto [normal, is_new] = of_cell.insert(normal_cell_key(cell), {});
    if (is_new) *normal = normal_of(cells.around(cell));
    normals[i] = *normal;
    if (normals[i].normal.dot(seen_from[i] - positions[i]) < 0.0F)
      normals[i].normal = -normals[i].normal;
  }
  return normals;
}

}  // namespace stillmap::mapping

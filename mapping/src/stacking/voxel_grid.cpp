#include "stacking/voxel_grid.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

constexpr std::uint64_t kLevelBits = 21;
constexpr std::uint64_t kSideBits = 10;
constexpr std::int64_t kLevelHalf = std::int64_t{1} << (kLevelBits - 1);
/// Beyond it, floats from the origin are no millimetres any more [tiles].
constexpr double kMostTiles = 1 << 20;

}  // namespace

Eigen::Vector3d map_origin_near(const Eigen::Vector3d& p_map) {
  const Eigen::Vector3d steps(maps::kTileSizeM, maps::kTileSizeM, 1.0);
  const Eigen::Vector3d origin = (p_map.array() / steps.array()).round() * steps.array();
  return origin + Eigen::Vector3d::Zero();  // turns -0 into 0
}

VoxelGrid::VoxelGrid(const Eigen::Vector3d& origin, double voxel_size_m)
    : origin_(origin),
      voxel_size_m_(voxel_size_m),
      inverse_voxel_(1.0 / voxel_size_m),
      last_side_(std::ceil(maps::kTileSizeM / voxel_size_m - 1e-9) - 1.0) {
  if (!(voxel_size_m >= 0.02)) throw std::invalid_argument("voxel size: expected >= 0.02");
}

std::optional<VoxelGrid::Place> VoxelGrid::find(const Eigen::Vector3d& p_map) const {
  const Eigen::Vector3d p = p_map - origin_;
  const Eigen::Array2d tile = (p.head<2>() / maps::kTileSizeM).array().floor();
  // Comparisons fail on NaN, so that what is not finite is too far as well.
  const double level = std::floor(p.z() * inverse_voxel_);
  if (!((tile.abs() < kMostTiles).all() && std::abs(level) < static_cast<double>(kLevelHalf)))
    return std::nullopt;
  const Eigen::Array2d in_tile = p.head<2>().array() - tile * maps::kTileSizeM;
  // A point just below a tile's border may round onto it: it stays in the last voxel.
  const Eigen::Array2d side = (in_tile * inverse_voxel_).floor().min(last_side_);
  Place place;
  place.tile = {0, static_cast<std::int32_t>(tile.x()), static_cast<std::int32_t>(tile.y())};
  place.voxel = static_cast<std::uint64_t>(side.x()) << (kSideBits + kLevelBits) |
                static_cast<std::uint64_t>(side.y()) << kLevelBits |
                static_cast<std::uint64_t>(static_cast<std::int64_t>(level) + kLevelHalf);
  place.offset =
      Eigen::Vector3d(in_tile.x() - side.x() * voxel_size_m_,
                      in_tile.y() - side.y() * voxel_size_m_, p.z() - level * voxel_size_m_)
          .cast<float>();
  return place;
}

Eigen::Vector3d VoxelGrid::position(maps::TileId tile, std::uint64_t voxel,
                                    const Eigen::Vector3d& offset) const {
  constexpr std::uint64_t kSideMask = (1U << kSideBits) - 1;
  constexpr std::uint64_t kLevelMask = (1U << kLevelBits) - 1;
  const Eigen::Array3d cell(
      static_cast<double>(voxel >> (kSideBits + kLevelBits) & kSideMask),
      static_cast<double>(voxel >> kLevelBits & kSideMask),
      static_cast<double>(static_cast<std::int64_t>(voxel & kLevelMask) - kLevelHalf));
  const Eigen::Array3d corner(tile.x * maps::kTileSizeM, tile.y * maps::kTileSizeM, 0.0);
  return corner + cell * voxel_size_m_ + offset.array();
}

}  // namespace stillmap::mapping

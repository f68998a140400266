#pragma once

#include <Eigen/Core>

#include <algorithm>
#include <bitset>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace stillmap::maps {

/// What the drives of a map saw of the space of a tile, in cubes of 1 m: 20 x 20 of them, 8 m high.
/// It tells what is gone from what nobody looked at.
struct TileEvidence {
  static constexpr int kSide = 20;
  static constexpr int kLayers = 8;
  static constexpr std::size_t kCubes = std::size_t{kSide} * kSide * kLayers;
  using Cubes = std::bitset<kCubes>;

  struct OfDrive {
    std::uint32_t drive = 0;
    /// Some view saw the middle of the cube free; in some view a return lies near it. Both may be.
    Cubes free, hit;
  };

  /// Where the lowest cubes begin, above the map's origin [m].
  std::int32_t base_m = 0;
  /// By drive, each once. Drives that saw nothing are left out.
  std::vector<OfDrive> drives;

  /// @return the cube of a point, by x, then y, then height; nothing above or below the cubes.
  /// @param p  from the tile's corner; its height from the map's origin [m]. x and y are clamped to
  /// the tile.
  [[nodiscard]] std::optional<std::size_t> cube_of(const Eigen::Vector3d& p) const {
    const double layer = std::floor(p.z() - base_m);
    if (!(layer >= 0.0 && layer < kLayers)) return std::nullopt;
    const auto along = [](double value) {
      return static_cast<std::size_t>(std::clamp(value, 0.0, kSide - 1.0));
    };
    return (along(p.x()) * kSide + along(p.y())) * kLayers + static_cast<std::size_t>(layer);
  }
  /// Middle of a cube, as `cube_of` takes it.
  [[nodiscard]] Eigen::Vector3d middle_of(std::size_t cube) const {
    const std::size_t column = cube / kLayers;
    return {static_cast<double>(column / kSide) + 0.5, static_cast<double>(column % kSide) + 0.5,
            base_m + static_cast<double>(cube % kLayers) + 0.5};
  }
  /// Cubes that some drive saw free, and in which none met anything.
  [[nodiscard]] Cubes free() const {
    Cubes free, hit;
    for (const OfDrive& each : drives) {
      free |= each.free;
      hit |= each.hit;
    }
    return free & ~hit;
  }
};

}  // namespace stillmap::maps

#include "reference/void_region.hpp"

#include "reference/voxel_ray.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>

namespace stillmap::mapping::reference {
namespace {

/// Voxels with a known state in the layer z of a block, bit y * 8 + x; `z` may lie up to 7 outside.
struct Layers {
  /// Blocks around one, by (dz + 1) * 9 + (dy + 1) * 3 + dx + 1; null where no ray went.
  std::array<const ScanSpace::Block*, 27> blocks{};

  Layers(const ScanSpace& space, const Eigen::Vector3i& middle_block) {
    std::size_t k = 0;
    for (int dz = -1; dz <= 1; ++dz) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
          blocks[k++] = space.find(middle_block + Eigen::Vector3i(dx, dy, dz));
        }
      }
    }
  }

  [[nodiscard]] std::uint64_t known(int z, int dy, int dx) const {
    const int dz = z >> 3;
    const auto k = static_cast<std::size_t>((dz + 1) * 9 + (dy + 1) * 3 + dx + 1);
    if (blocks[k] == nullptr) return 0;
    const auto word = static_cast<std::size_t>(z & 7);
    return blocks[k]->free[word] | blocks[k]->hit[word];
  }
};

/// In each of 8 bytes the lowest `count` bits.
std::uint64_t low_bits(int count) {
  return 0x0101010101010101ULL * ((std::uint64_t{1} << count) - 1);
}

/// Voxels of a row whose neighbours within `reach` on the x axis are set too.
std::uint64_t eroded_x(std::uint64_t left, std::uint64_t row, std::uint64_t right, int reach) {
  std::uint64_t result = row;
  for (int d = 1; d <= reach; ++d) {
    const std::uint64_t low = low_bits(d);
    const std::uint64_t high = ~low_bits(8 - d);
    result &= ((row << d) & ~low) | ((left >> (8 - d)) & low);
    result &= ((row >> d) & ~high) | ((right << (8 - d)) & high);
  }
  return result;
}

std::uint64_t eroded_y(std::uint64_t before, std::uint64_t layer, std::uint64_t after, int reach) {
  std::uint64_t result = layer;
  for (int d = 1; d <= reach; ++d) {
    result &= (layer << (8 * d)) | (before >> (64 - 8 * d));
    result &= (layer >> (8 * d)) | (after << (64 - 8 * d));
  }
  return result;
}

std::uint64_t eroded_layer(const Layers& layers, int z, int reach) {
  const auto row = [&](int dy) {
    return eroded_x(layers.known(z, dy, -1), layers.known(z, dy, 0), layers.known(z, dy, 1), reach);
  };
  const std::uint64_t middle_row = row(0);
  return middle_row == 0 ? 0 : eroded_y(row(-1), middle_row, row(1), reach);
}

}  // namespace

void mark_free(const ScanRays& rays, int beyond, ScanSpace& space) {
  for (const Eigen::Vector3i& end : rays.ends) {
    VoxelRay ray(rays.sensor, middle_of(end));
    ScanCursor cursor(space, voxel_of(rays.sensor));
    cursor.set_free();
    for (int left = ray.steps(); left > 0 && !cursor.is_hit(); --left) {
      const int axis = ray.advance();
      cursor.step(axis, ray.sign(axis));
      cursor.set_free();
    }
    std::array<int, 3> gone{};
    while (*std::max_element(gone.begin(), gone.end()) < beyond) {
      const int axis = ray.advance();
      cursor.step(axis, ray.sign(axis));
      cursor.set_free();
      ++gone[static_cast<std::size_t>(axis)];
    }
  }
}

BlockBits void_region(const ScanSpace& space, std::size_t block, int unknown_voxels) {
  const ScanSpace::Block& centre = space.block(block);
  BlockBits result{};
  bool any = false;
  for (std::size_t z = 0; z < 8; ++z) {
    result[z] = centre.free[z] & ~centre.hit[z];
    any = any || result[z] != 0;
  }
  if (!any) return result;
  const Layers layers(space, space.position(block));
  for (int z = -unknown_voxels; z < 8 + unknown_voxels; ++z) {
    const std::uint64_t layer = eroded_layer(layers, z, unknown_voxels);
    const int last = std::min(7, z + unknown_voxels);
    for (int k = std::max(0, z - unknown_voxels); k <= last; ++k) {
      result[static_cast<std::size_t>(k)] &= layer;
    }
  }
  return result;
}

}  // namespace stillmap::mapping::reference

#pragma once

#include "stacking/voxel_grid.hpp"
#include "stacking/voxel_sums.hpp"

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <vector>

namespace stillmap::mapping {

/// One point on its way into the map.
struct StackedPoint {
  Eigen::Vector3d p_map = Eigen::Vector3d::Zero();
  float intensity = 0.0F;
  maps::PointKind kind = maps::PointKind::kMeasured;
  /// Number of its object plus 1, for projected points.
  std::uint32_t object = 0;
};

/// The points of one scan, reduced to voxels tile by tile. Made a scan each in parallel, so that
/// little is left to do in order.
class ScanVoxels {
 public:
  /// @param scan  ordinal.
  ScanVoxels(const VoxelGrid& grid, std::uint32_t scan) : grid_(&grid), scan_(scan) {}

  /// @return false for a point beyond the grid, which is left out.
  bool add(const StackedPoint& point);

  [[nodiscard]] std::uint32_t scan() const { return scan_; }
  [[nodiscard]] const std::map<maps::TileId, VoxelSums>& tiles() const { return tiles_; }

 private:
  const VoxelGrid* grid_;
  std::uint32_t scan_;
  std::map<maps::TileId, VoxelSums> tiles_;
  /// Points follow each other in space.
  VoxelSums* last_ = nullptr;
  maps::TileId last_tile_;
};

/// Collects scans into tiles. When there are too many voxels, tiles that no scan met lately go to a
/// scratch file, and come back when they are met again. So each sum is added up in the order of the
/// scans, and its bits depend on no other tile. Tiles that recent scans met stay in memory, however
/// many voxels they have: else each scan would write and read all of them.
class TileStack {
 public:
  /// @param scratch_file  made when needed, removed at the end.
  /// @param most_voxels   in memory, > 0; more only where the tiles of recent scans have more.
  TileStack(std::filesystem::path scratch_file, std::size_t most_voxels);
  ~TileStack();
  TileStack(const TileStack&) = delete;
  TileStack& operator=(const TileStack&) = delete;

  /// @param scan    of a later ordinal than the one before.
  /// @param wanted  whether a tile is collected; empty: all are. @throws maps::StorageError.
  void add(const ScanVoxels& scan, const std::function<bool(maps::TileId)>& wanted = {});

  [[nodiscard]] std::size_t voxels_in_memory() const { return voxels_; }
  /// All tiles that hold something, in order.
  [[nodiscard]] std::vector<maps::TileId> tiles() const;
  /// A tile's voxels by key. From several threads. @throws maps::StorageError.
  [[nodiscard]] std::vector<VoxelSum> read(maps::TileId id) const;
  /// The same, and what memory holds of the tile is given back. From several threads, for different
  /// tiles.
  [[nodiscard]] std::vector<VoxelSum> take(maps::TileId id);

 private:
  struct Part {
    std::uint64_t offset = 0;
    std::size_t voxels = 0;
  };
  struct Tile {
    VoxelSums voxels;
    /// Where they are while they are not in memory.
    std::optional<Part> written;
    std::uint32_t last_scan = 0;
  };
  struct Close {
    void operator()(std::FILE* stream) const { std::fclose(stream); }
  };
  void spill(std::uint32_t scan);
  void write(Tile& tile);
  void give_back(Part part) const;
  void bring_back(Tile& tile);
  [[nodiscard]] std::vector<VoxelSum> read_back(Part part) const;

  std::filesystem::path scratch_file_;
  std::size_t most_voxels_;
  std::size_t voxels_ = 0;
  std::map<maps::TileId, Tile> tiles_;
  std::unique_ptr<std::FILE, Close> scratch_;
  std::uint64_t written_ = 0;
};

}  // namespace stillmap::mapping

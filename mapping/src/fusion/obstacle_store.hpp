#pragma once

#include "fusion/obstacle_map.hpp"

#include <stillmap/maps/cell_table.hpp>
#include <stillmap/maps/scratch_file.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

namespace stillmap::mapping {

/// What stands on the ground, from all scans of a drive: far more of a thing than any one of them
/// shows. Drive by drive: another day another car stands on the same spot, and both together have
/// the shape of neither.
///
/// Memory is bounded, whatever the length of a drive: sums of voxels go to a scratch file, sorted,
/// when there are too many, and are merged at the drive's end. When that happens depends on the
/// scans alone, so that the sums are the same bits on every machine.
class ObstacleStore {
 public:
  static constexpr std::size_t kMostVoxels = 1'000'000;

  /// @param scratch  existing folder; the file there is removed with the store.
  /// @param most_voxels  in memory, > 0.
  explicit ObstacleStore(std::filesystem::path scratch, std::size_t most_voxels = kMostVoxels)
      : folder_(std::move(scratch)), most_voxels_(most_voxels) {}
  ObstacleStore(const ObstacleStore&) = delete;
  ObstacleStore& operator=(const ObstacleStore&) = delete;

  /// Serial, in the scans' order.
  /// @throws std::invalid_argument for a drive before the last one; maps::StorageError naming the
  /// file, e.g. on a full disk.
  void add(std::size_t drive, const ScanObstacles& scan);
  /// Ends the adding. Once. @throws maps::StorageError.
  void finish();

  /// Those whose x and y lie in a circle [m], and some around it. Only after `finish`. Safe from
  /// several threads. @throws maps::StorageError naming the file.
  [[nodiscard]] ObstacleMap around(std::size_t drive, const Eigen::Vector2d& centre,
                                   double radius_m) const;

 private:
  /// Of one voxel, as it lies in the file.
  struct Sum {
    std::uint64_t key = 0;
    float x = 0.0F, y = 0.0F, z = 0.0F;
    std::uint32_t points = 0, scans = 0;
    std::uint32_t unused = 0;
  };
  struct Part {
    std::uint64_t offset_bytes = 0;
    std::size_t items = 0;
  };
  class Run;
  /// Drive, then the place of the patch.
  using PatchId = std::tuple<std::size_t, std::int32_t, std::int32_t>;

  [[nodiscard]] maps::ScratchFile& file();
  /// Sorts the sums and puts them into the file.
  void write_run();
  void finish_drive();
  void write_patch(const PatchId& id, std::vector<Obstacle> obstacles);

  std::filesystem::path folder_;
  std::size_t most_voxels_;
  std::optional<maps::ScratchFile> scratch_;
  std::optional<std::size_t> drive_;
  /// Of the last drive, until it is finished.
  maps::CellMap<Sum> sums_;
  std::vector<Part> runs_;
  /// A patch has more than one part where a rounded mean lies outside of its voxel.
  std::map<PatchId, std::vector<Part>> patches_;
};

}  // namespace stillmap::mapping

#pragma once

#include "core/scratch_file.hpp"
#include "fusion/obstacle_map.hpp"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <utility>

namespace stillmap::mapping {

/// What stands on the ground, drive by drive: another day another car stands on the same spot, and
/// both together have the shape of neither.
///
/// Memory holds the map of the last drive alone; those before it lie in a scratch file, which a
/// single drive never needs.
class ObstacleStore {
 public:
  /// @param scratch  existing folder; a file is made there when a second drive begins, and removed
  /// with the store.
  explicit ObstacleStore(std::filesystem::path scratch) : folder_(std::move(scratch)) {}
  ObstacleStore(const ObstacleStore&) = delete;
  ObstacleStore& operator=(const ObstacleStore&) = delete;

  /// Serial, in the scans' order.
  /// @throws std::invalid_argument for a drive before the last one; maps::StorageError naming the
  /// file, e.g. on a full disk.
  void add(std::size_t drive, const ScanObstacles& scan);
  /// Ends the adding. Once.
  void finish();

  /// Only after `finish`. Safe from several threads.
  /// @throws std::out_of_range for a drive without a scan; maps::StorageError naming the file.
  [[nodiscard]] std::shared_ptr<const ObstacleMap> read(std::size_t drive) const;

 private:
  struct Part {
    std::uint64_t offset_bytes = 0;
    std::size_t obstacles = 0;
  };
  void write_last();

  std::filesystem::path folder_;
  std::optional<ScratchFile> scratch_;
  std::map<std::size_t, Part> parts_;
  std::size_t last_drive_ = 0;
  /// Null before the first scan.
  std::shared_ptr<ObstacleMap> last_;
};

}  // namespace stillmap::mapping

#pragma once

#include "catalog/map_catalog.hpp"
#include "derived/derived_worker.hpp"
#include "derived/recently_used.hpp"

#include <stillmap/maps/map_difference.hpp>
#include <stillmap/maps/map_levels.hpp>
#include <stillmap/maps/tileset.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::server {

/// Levels of detail of one version, ready to be served.
struct ServedLevels {
  std::shared_ptr<const maps::MapLevels> levels;
  maps::Tileset tileset;
};
struct LevelTile {
  maps::TileEntry entry;
  /// From the tile's corner.
  std::vector<maps::MapPoint> points;
};

/// Two versions of a map, and how near points must be to be the same.
struct ComparedVersions {
  ServedVersion version, other;
  double tolerance_m = 0.0;

  /// Names what is found, as no other pair of contents and tolerance does.
  [[nodiscard]] std::string name() const;
};
struct DifferenceState {
  /// Null while it is made.
  std::shared_ptr<const maps::MapDifference> ready;
  /// Share that is done, in [0, 1].
  double progress = 0.0;
};

/// The versions of maps for who looks at them: their own tiles, and what is derived from these,
/// opened where it lies beside the package and made in the background where it does not, never from
/// a package with a damaged tile. Keeps some of them open. Safe from several threads.
class MapViews {
 public:
  /// What is derived leaves so much of the disk [bytes] to what is not.
  static constexpr std::uint64_t kLeftFree = std::uint64_t{512} << 20U;

  /// @param store  the store's folder, which messages do not name. @param left_free  as
  /// `kLeftFree`.
  explicit MapViews(std::filesystem::path store, std::uint64_t left_free = kLeftFree)
      : store_(std::move(store)), left_free_(left_free) {}

  /// Points of a tile that the package itself holds, from the tile's corner. It is compared with
  /// its checksum the first time that it is asked for. Empty when there is none.
  /// @throws maps::InputError naming the file when it is damaged.
  [[nodiscard]] std::vector<maps::MapPoint> own_tile(const ServedVersion& version, maps::TileId id);

  /// Has the levels made in the background, if they are not there, of a package that was just
  /// opened.
  void warm(const maps::MapPackage& package);
  /// @throws ApiError kBeingMade with Retry-After, while it is made; kDerivedUnavailable, kBusy.
  [[nodiscard]] std::shared_ptr<const ServedLevels> levels(const ServedVersion& version);
  /// A tile from level 1 on; nothing when there is none. What turns out to be damaged is made anew.
  /// @throws as `levels`.
  [[nodiscard]] std::optional<LevelTile> level_tile(const ServedVersion& version, maps::TileId id);

  /// One that is open already; null otherwise.
  [[nodiscard]] std::shared_ptr<const maps::MapDifference> open_difference(
      const ComparedVersions& pair);
  /// @throws ApiError kDerivedUnavailable, kBusy.
  [[nodiscard]] DifferenceState difference(const ComparedVersions& pair);
  /// @param tile  of this difference. What turns out to be damaged is made anew.
  /// @throws ApiError kBeingMade, and as `difference`.
  [[nodiscard]] std::vector<maps::MapPoint> difference_points(const ComparedVersions& pair,
                                                              const maps::MapDifference& difference,
                                                              const maps::DifferenceTile& tile);

 private:
  DerivedWorker::Answer ask_for_levels(const maps::MapPackage& package);

  [[nodiscard]] maps::DerivedWork leaving_room(const maps::DerivedWork& work) const;

  /// Tiles of one copy of a package that were found whole.
  struct WholeTiles {
    mutable std::mutex mutex;
    mutable std::set<maps::TileId> ids;
  };

  std::filesystem::path store_;
  std::uint64_t left_free_;
  RecentlyUsed<WholeTiles> whole_tiles_{64};
  /// Their tables, no points.
  RecentlyUsed<ServedLevels> levels_{8};
  RecentlyUsed<maps::MapDifference> differences_{8};
  DerivedWorker worker_;
};

}  // namespace stillmap::server

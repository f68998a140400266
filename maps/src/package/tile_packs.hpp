#pragma once

#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/mapped_file.hpp>

#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "package/region_node.hpp"
#include "package/tile_bytes.hpp"

namespace stillmap::maps {

/// x, y of a region: of its tiles, divided by 32.
struct RegionId {
  std::int32_t x = 0;
  std::int32_t y = 0;
  auto operator<=>(const RegionId&) const = default;
};
[[nodiscard]] RegionId region_of(TileId tile);

/// `regions/X_Y.node`
[[nodiscard]] std::string region_path(RegionId region);
/// `packs/` and the SHA-256 of the pack as hex.
[[nodiscard]] std::string pack_path(const Pack& pack);

/// Writes tiles into packs and nodes of a package's folder. Tiles may come in any order; the files
/// do not tell.
class PackWriter {
 public:
  /// @throws StorageError if the folders cannot be made.
  explicit PackWriter(std::filesystem::path folder);
  ~PackWriter();
  PackWriter(const PackWriter&) = delete;
  PackWriter& operator=(const PackWriter&) = delete;

  /// @param id  of level 0. @throws std::invalid_argument for another level, for a tile that was
  /// added before or cannot be encoded; StorageError.
  void add(TileId id, const TileContent& tile);
  /// Writes what remains; nothing may be added then. @throws StorageError.
  void finish();

 private:
  struct Region;

  std::filesystem::path folder_;
  std::map<RegionId, std::unique_ptr<Region>> regions_;
};

/// Reads tiles from packs and nodes. Nodes are read when it is opened, packs are mapped when one of
/// their tiles is asked for. Safe from several threads.
class PackReader {
 public:
  /// @param regions  that the package lists. @throws InputError for a node that is none or whose
  /// packs are missing or of another size; StorageError.
  PackReader(std::filesystem::path folder, const std::vector<RegionId>& regions);
  ~PackReader();

  /// Tiles by x, then y, with what is known of them without reading them.
  [[nodiscard]] const std::vector<std::pair<TileId, RegionTile>>& tiles() const { return tiles_; }
  /// Null when there is no such tile.
  [[nodiscard]] const RegionTile* find(TileId id) const;
  /// As they lie in the pack; empty when there is no such tile. Valid as long as this.
  [[nodiscard]] std::span<const std::byte> bytes(TileId id) const;
  /// @throws InputError naming the pack, what was found and what to do, when the bytes are not
  /// those of the node; std::invalid_argument when there is no such tile.
  void require_whole(TileId id) const;

 private:
  const MappedFile& mapped(const std::string& pack) const;

  std::filesystem::path folder_;
  std::vector<std::pair<TileId, RegionTile>> tiles_;
  std::map<RegionId, std::vector<Pack>> packs_;
  mutable std::mutex mutex_;
  mutable std::map<std::string, std::unique_ptr<MappedFile>> mapped_;
};

}  // namespace stillmap::maps

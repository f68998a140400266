#pragma once

#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/mapped_file.hpp>
#include <stillmap/maps/region.hpp>

#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "package/region_node.hpp"
#include "package/tile_bytes.hpp"

namespace stillmap::maps {

/// `regions/X_Y.node`
[[nodiscard]] std::string region_path(RegionId region);
/// The region that a path of a package is the node of; nothing for other paths.
[[nodiscard]] std::optional<RegionId> region_of_path(const std::string& path);
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

/// Reads tiles from packs and nodes. All files are opened at once, so that tiles stay readable when
/// the package is removed; a pack's pages are read when they are touched. Safe from several
/// threads.
class PackReader {
 public:
  /// @param regions  that the package lists. @throws InputError for a node that is none or whose
  /// packs are missing or of another size; StorageError.
  PackReader(const std::filesystem::path& folder, const std::vector<RegionId>& regions);

  /// Tiles by x, then y, with what is known of them without reading them.
  [[nodiscard]] const std::vector<std::pair<TileId, RegionTile>>& tiles() const { return tiles_; }
  /// Null when there is no such tile.
  [[nodiscard]] const RegionTile* find(TileId id) const;
  /// As they lie in the pack; empty when there is no such tile. Valid as long as this.
  [[nodiscard]] std::span<const std::byte> bytes(TileId id) const;
  /// Name of a tile with its pack, for messages. @throws std::out_of_range for one that is none.
  [[nodiscard]] std::string name_of(TileId id) const;

 private:
  struct OpenPack {
    std::string path;
    std::unique_ptr<MappedFile> file;
  };
  [[nodiscard]] const OpenPack& pack_of(TileId id, const RegionTile& tile) const;

  std::vector<std::pair<TileId, RegionTile>> tiles_;
  std::map<RegionId, std::vector<OpenPack>> packs_;
};

/// SHA-256 as lower-case hex.
[[nodiscard]] std::string hex_of(const Sha256Bytes& digest);

}  // namespace stillmap::maps

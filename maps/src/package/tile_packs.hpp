#pragma once

#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/mapped_file.hpp>
#include <stillmap/maps/region.hpp>

#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
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
/// What a node says of a tile.
[[nodiscard]] TileEntry entry_of(RegionId region, const RegionTile& tile);
/// Whether a path of a package is that of a pack.
[[nodiscard]] bool is_pack(const std::string& path);

class PackReader;

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
  /// Takes over the tiles of another package but some: their packs lie in this one, too. Once. In
  /// a region that changes, tiles of a pack of which less than half is taken over are written
  /// again, so that a package is never more than twice as large as its tiles.
  /// @param from  lives until `finish` has returned.
  void take_over(const PackReader& from, std::set<TileId> except);
  /// Writes what remains; nothing may be added then. @return the tiles, by x, then y.
  /// @throws StorageError.
  std::vector<TileEntry> finish();

 private:
  struct Region;

  /// The tiles of a region that are taken over, with packs of their own package.
  struct TakenOver {
    std::vector<Pack> packs;
    std::vector<RegionTile> tiles;
  };
  [[nodiscard]] TakenOver taken_over(RegionId number);
  /// Puts a tile's bytes behind those of its region.
  void append(RegionId number, RegionTile row, std::span<const std::byte> bytes);
  /// Gives the pack that a region's new tiles have come into its name.
  [[nodiscard]] Pack finished(Region& region) const;

  std::filesystem::path folder_;
  std::map<RegionId, std::unique_ptr<Region>> regions_;
  const PackReader* from_ = nullptr;
  std::set<TileId> except_;
};

/// Reads tiles from packs and nodes. All files are opened at once, so that tiles stay readable when
/// the package is removed; nothing is read from them before somebody asks. Whatever asks for a tile
/// throws InputError for a node that is none or whose packs the package does not list. Safe from
/// several threads.
class PackReader {
 public:
  /// @param files  of the package: nodes and packs among them are opened. @throws InputError for a
  /// node whose name is none, StorageError.
  PackReader(const std::filesystem::path& folder,
             const std::map<std::string, MapManifest::File>& files);

  /// By x, then y.
  [[nodiscard]] std::vector<RegionId> regions() const;
  /// By x, then y; none for a region that the package does not list.
  [[nodiscard]] std::vector<TileEntry> tiles(RegionId id) const;
  /// Its packs and tiles as they lie in the file; empty for a region that the package does not
  /// list. Valid as long as this.
  [[nodiscard]] RegionNode node(RegionId id) const { return region(id).node; }
  /// Where the package lies.
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }
  /// Null when there is no such tile.
  [[nodiscard]] const RegionTile* find(TileId id) const;
  [[nodiscard]] std::optional<TileEntry> entry(TileId id) const;
  /// As they lie in the pack; empty when there is no such tile. Valid as long as this.
  [[nodiscard]] std::span<const std::byte> bytes(TileId id) const;
  /// As `MapPackage::release_pages`.
  void release_pages() const;
  /// Name of a tile with its pack, for messages. @throws std::out_of_range for one that is none.
  [[nodiscard]] std::string name_of(TileId id) const;

 private:
  /// Path in the package, and the bytes.
  using NamedPack = std::pair<const std::string, MappedFile>;
  struct Region {
    Region() = default;
    explicit Region(const std::filesystem::path& path) : file(path) {}
    std::optional<MappedFile> file;
    std::once_flag once;
    /// As it lies in the file, when it was read; its packs.
    RegionNode node;
    std::vector<const NamedPack*> packs;
  };
  /// Of a region that the package does not list: without tiles.
  [[nodiscard]] const Region& region(RegionId id) const;
  [[nodiscard]] const NamedPack& pack_of(TileId id, const RegionTile& tile) const;

  std::filesystem::path folder_;
  mutable std::map<RegionId, Region> regions_;
  /// By path.
  std::map<std::string, MappedFile> packs_;
};

/// SHA-256 as lower-case hex.
[[nodiscard]] std::string hex_of(const Sha256Bytes& digest);

}  // namespace stillmap::maps

#pragma once

#include <stillmap/maps/store/disk_calls.hpp>
#include <stillmap/maps/store/store_refusal.hpp>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// A published version of a map.
struct StoredVersion {
  /// As the publisher named it; like a map's name.
  std::string name;
  /// SHA-256 of its package's manifest, hex.
  std::string digest;
  /// Of its files, manifest included.
  std::uint64_t bytes = 0;
  std::int64_t created_ns = 0;
  auto operator<=>(const StoredVersion&) const = default;
};

/// A map of the store.
struct StoredMap {
  std::string name;
  std::optional<std::string> active;
  /// Active before; what rolling back goes to.
  std::optional<std::string> previous;
  /// Grows with every change of the active pointer, never goes back.
  std::int64_t revision = 0;
  std::int64_t created_ns = 0;
  auto operator<=>(const StoredMap&) const = default;
};

/// Names, versions and active pointers of a store, in one database that outlives a power cut: what
/// returned is kept. Knows nothing of packages on the disk. Safe from several threads, and
/// several processes may have it open. Throws StorageError when the disk fails; a change has then
/// not happened, or (a failed sync) may show after the next open.
class StoreState {
 public:
  /// Opens or makes it, and brings an older schema up to date. @param calls  outlives this.
  /// @throws InputError for a database that is not ours or has a newer schema.
  explicit StoreState(const std::filesystem::path& file, DiskCalls& calls = DiskCalls::real());
  ~StoreState();
  StoreState(const StoreState&) = delete;
  StoreState& operator=(const StoreState&) = delete;

  /// Sorted by name.
  [[nodiscard]] std::vector<StoredMap> maps() const;
  /// @throws StoreRefusal kUnknownMap.
  [[nodiscard]] StoredMap map(std::string_view name) const;
  /// Oldest first. @throws StoreRefusal kUnknownMap.
  [[nodiscard]] std::vector<StoredVersion> versions(std::string_view map) const;
  /// @throws StoreRefusal kUnknownMap, kUnknownVersion.
  [[nodiscard]] StoredVersion version(std::string_view map, std::string_view version) const;
  /// The same, or nothing.
  [[nodiscard]] std::optional<StoredVersion> find_version(std::string_view map,
                                                          std::string_view version) const;
  /// Whether any version of any map holds this package.
  [[nodiscard]] bool uses(std::string_view digest) const;

  /// Makes the map with it when it is new.
  /// @return false when the same is there already. @throws StoreRefusal kOtherDigest.
  bool add_version(std::string_view map, const StoredVersion& version);
  /// What is active already stays so, with its revision.
  /// @param revision  only when the map is still at it. @return the map afterwards.
  /// @throws StoreRefusal kUnknownMap, kUnknownVersion, kOtherRevision.
  StoredMap activate(std::string_view map, std::string_view version,
                     std::optional<std::int64_t> revision = {});
  /// Swaps the active version with the one before. @throws StoreRefusal kUnknownMap, kNoPrevious,
  /// kOtherRevision.
  StoredMap roll_back(std::string_view map, std::optional<std::int64_t> revision = {});
  /// A package that no version holds any more is noted as `condemned`.
  /// @throws StoreRefusal kUnknownMap, kUnknownVersion, kActive.
  void remove_version(std::string_view map, std::string_view version);

  /// Packages whose last version was removed, and which may lie on the disk still.
  [[nodiscard]] std::vector<std::string> condemned() const;
  /// Its package is gone from the disk.
  void forget_condemned(std::string_view digest);
  /// What SQLite finds wrong with the database; empty when sound.
  [[nodiscard]] std::vector<std::string> problems() const;

 private:
  struct Inner;
  std::unique_ptr<Inner> inner_;
};

}  // namespace stillmap::maps

#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <stillmap/maps/map_package.hpp>
#include "store/folder_lock.hpp"
#include "store/store_state.hpp"

namespace stillmap::server {

/// Where the files of a store's packages are when they are not in its folder: each once, as a blob
/// that is named by its SHA-256. A package is named by that of its manifest, which is a blob, too.
/// Packages that are read come to a folder on the local disk. Safe from several threads. All
/// members throw StorageError when the blobs or the local disk cannot be reached.
class PackageBlobs {
 public:
  PackageBlobs() = default;
  virtual ~PackageBlobs() = default;
  PackageBlobs(const PackageBlobs&) = delete;
  PackageBlobs& operator=(const PackageBlobs&) = delete;

  /// Folder on the local disk with the packages that are there just now, named by digest.
  [[nodiscard]] virtual std::filesystem::path packages() const = 0;
  /// Held while folders come and go there.
  [[nodiscard]] virtual FolderLock locked() const = 0;

  /// A package on the local disk.
  struct Local {
    std::filesystem::path folder;
    /// It stays there as long as this; null where it stays anyway.
    std::shared_ptr<void> pin;
  };
  /// Brings a package to the local disk.
  /// @throws also InputError for bytes that are not what their names say.
  [[nodiscard]] virtual Local bring(const std::string& digest) = 0;
  /// The same of one that is there already; nothing when it must be fetched.
  [[nodiscard]] virtual std::optional<Local> find_local(const std::string& digest) const = 0;
  /// Compares what lies of a package on the local disk with its checksums: all of it is read. What
  /// is wrong is removed, so that `bring` fetches it again. @return whether anything was wrong.
  virtual bool drop_damaged(const std::string& digest) = 0;
  /// The manifest alone.
  [[nodiscard]] virtual maps::MapManifest manifest(const std::string& digest) = 0;
  /// The same for those who can do without it: one try of a few seconds for all that ask.
  [[nodiscard]] virtual maps::MapManifest manifest_if_near(const std::string& digest) = 0;
  /// Puts one file to a new path below the folder of `packages`.
  virtual void bring_file(const maps::MapManifest::File& file, const std::filesystem::path& to) = 0;

  /// Sends the files of a package, the manifest last.
  /// @param package  below the folder of `packages`. @param there  need not be sent.
  /// @param again    even those that seem to be there.
  virtual void send(const std::filesystem::path& package, const FileBytes& there, bool again) = 0;
  /// The same, but only what is missing: while a package was sent, the removal of another one may
  /// have taken files that both have. Under the store's lock, before the package gets a row.
  /// @param there  those of packages with a row.
  virtual void confirm(const std::filesystem::path& package, const FileBytes& there) = 0;

  /// Of files that were read: what is wrong with them, by SHA-256; empty when nothing.
  using Verified = std::map<std::string, std::string>;
  /// Reads a whole package. @param known  is not read again, and gets what was read.
  /// @return what is missing or wrong; empty when the package is whole.
  [[nodiscard]] virtual std::string damage_of(const std::string& digest, Verified& known) = 0;

  /// Removes the files of a package, the manifest last. Under the store's lock.
  /// @param kept  files of other packages.
  virtual void remove(const std::string& digest, const FileBytes& kept) = 0;
  /// Blobs that no package has, but those that may be of one that is being sent.
  /// @throws InputError when there are blobs and none of them is known: those of another store?
  [[nodiscard]] virtual std::vector<std::string> unnamed(const FileBytes& named) = 0;
  virtual void remove_blobs(const std::vector<std::string>& sha256s) = 0;

  /// For those who operate a server. Counts begin with the program.
  struct Figures {
    /// Whether the newest request got no answer, and that is less than a minute ago.
    bool is_away = false;
    /// Tries of requests that got an answer, be it a refusal, and tries that got none.
    std::uint64_t answered = 0, failed = 0;
    /// Of the local disk: what lies there, and files that were found there or fetched.
    std::uint64_t local_bytes = 0, found = 0, fetched = 0;
  };
  [[nodiscard]] virtual Figures figures() const = 0;
  /// The program ends: what is under way fails, and nothing begins.
  virtual void stop() = 0;
};

}  // namespace stillmap::server

#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "store/durable_files.hpp"
#include "store/folder_lock.hpp"

namespace stillmap::server {

/// The packages of a store on its disk, each in a folder that is named by its digest. `StoreState`
/// knows which versions name them. Who adds or removes one holds the store's lock.
class PackageFolder {
 public:
  /// @param calls  outlives this.
  PackageFolder(std::filesystem::path folder, DiskCalls& calls);

  [[nodiscard]] const std::filesystem::path& path() const { return folder_; }
  [[nodiscard]] std::filesystem::path path_of(std::string_view digest) const;
  /// Of what lies there, whether a version names it or not.
  [[nodiscard]] std::vector<std::string> digests() const;
  [[nodiscard]] bool has(const std::string& digest) const;
  [[nodiscard]] bool has_whole(const std::string& digest) const;
  /// What is wrong with the package in the place of this digest; empty when it is whole. Reads all.
  [[nodiscard]] std::string damage_of(const std::string& digest) const;

  /// It vanishes at once; a half deleted package is never seen.
  void remove(const std::string& digest) const;
  /// Removes what killed writers left; what is being written right now stays. @return how much.
  std::size_t clear_leftovers() const;
  /// Makes what came and went last.
  void sync() const;

  /// A folder beside the packages that is being filled, locked against `clear_leftovers`. Unless it
  /// is published, it goes with this.
  class Incoming {
   public:
    /// Under the store's lock.
    Incoming(const PackageFolder& packages, DurableFiles files);
    ~Incoming();
    Incoming(const Incoming&) = delete;
    Incoming& operator=(const Incoming&) = delete;

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// A package that lies there already is replaced in one step, and goes with this.
    /// @param package  this folder, or one in it; then the rest goes with this.
    void publish(const std::filesystem::path& package, const std::filesystem::path& target);

   private:
    DurableFiles files_;
    std::filesystem::path path_;
    std::optional<FolderLock> lock_;
    /// Published, or not to be touched.
    bool stays_ = false;
  };

 private:
  std::filesystem::path folder_;
  DurableFiles files_;
};

}  // namespace stillmap::server

#pragma once

#include <stillmap/maps/partial_folder.hpp>

#include <filesystem>

namespace stillmap::maps {

/// A file that is written beside its final place and appears there whole or not at all, as
/// `PartialFolder` does it for folders.
class PartialFile {
 public:
  /// @throws InputError if `target` exists or another process writes it right now, StorageError if
  /// its folder cannot be written.
  explicit PartialFile(const std::filesystem::path& target);

  /// What to write until `publish`.
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

  /// Flushes it to the disk, then renames it. Once only.
  /// @throws StorageError; InputError if the target has appeared meanwhile.
  void publish();

 private:
  PartialFolder folder_;
  std::filesystem::path path_;
};

}  // namespace stillmap::maps

#pragma once

#include <filesystem>
#include <string>

namespace stillmap::maps {

/// A folder that is filled beside its final place, as `<parent>/.<name>.partial`, and appears there
/// whole or not at all. What a killed process left is cleared by the next one; two live ones are
/// told apart by a lock.
class PartialFolder {
 public:
  /// @param survivor  name of a folder in it that the next process finds as it was left, whether
  /// this one was killed or gave up. Never published; empty = none.
  /// @throws InputError if `target` exists or another process fills it right now, StorageError if
  /// its
  ///         parent cannot be written.
  explicit PartialFolder(const std::filesystem::path& target, std::string survivor = {});
  /// Removes what was not published, all but a survivor that exists.
  ~PartialFolder();
  PartialFolder(const PartialFolder&) = delete;
  PartialFolder& operator=(const PartialFolder&) = delete;

  /// Where to put files until `publish`.
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] const std::filesystem::path& target() const { return target_; }

  /// Flushes every file and folder to the disk, removes the survivor, then renames to the target.
  /// @throws StorageError; InputError if the target has appeared meanwhile.
  void publish();

 private:
  std::filesystem::path target_;
  std::filesystem::path path_;
  std::string survivor_;
  int lock_ = -1;
  bool published_ = false;
};

}  // namespace stillmap::maps

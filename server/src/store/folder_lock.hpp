#pragma once

#include <filesystem>
#include <optional>

namespace stillmap::server {

/// An exclusive lock on a file or folder, between processes and between threads. It ends with the
/// process.
class FolderLock {
 public:
  /// Waits for it. Makes the file when there is none. @throws StorageError.
  explicit FolderLock(const std::filesystem::path& file);
  /// @return nothing when someone else holds it. @throws StorageError.
  static std::optional<FolderLock> try_folder(const std::filesystem::path& folder);
  ~FolderLock();
  FolderLock(FolderLock&& other) noexcept;
  FolderLock& operator=(FolderLock&& other) noexcept;
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  explicit FolderLock(int descriptor) : descriptor_(descriptor) {}
  int descriptor_;
};

}  // namespace stillmap::server

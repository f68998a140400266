#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

namespace stillmap::server {

/// A lock on a file or folder, between processes and between threads. It ends with the process.
class FolderLock {
 public:
  enum class Kind : std::uint8_t { kExclusive, kShared };
  /// Waits for it, exclusive. Makes the file when there is none. @throws StorageError.
  explicit FolderLock(const std::filesystem::path& file);
  /// @return nothing when someone else holds one that excludes it. @throws StorageError.
  static std::optional<FolderLock> try_folder(const std::filesystem::path& folder,
                                              Kind kind = Kind::kExclusive);
  ~FolderLock();
  /// Whether the path still leads to what is locked.
  [[nodiscard]] bool is_of(const std::filesystem::path& path) const;
  FolderLock(FolderLock&& other) noexcept;
  FolderLock& operator=(FolderLock&& other) noexcept;
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  explicit FolderLock(int descriptor) : descriptor_(descriptor) {}
  int descriptor_;
};

}  // namespace stillmap::server

#pragma once

#include <cstddef>
#include <filesystem>
#include <span>

namespace stillmap::maps {

/// A whole regular file as read-only memory: the system reads its pages when they are touched, and
/// may drop them again.
///
/// If another program shortens the file meanwhile, touching what is gone ends the process (SIGBUS).
/// A server maps only files that are replaced whole, never rewritten.
class MappedFile {
 public:
  enum class Reading {
    kAnywhere,
    /// Once, from the beginning to the end: the system reads ahead.
    kInOrder,
  };

  /// @throws StorageError naming the file and the system's reason.
  explicit MappedFile(const std::filesystem::path& file, Reading reading = Reading::kAnywhere);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;

  /// Frees the memory of the pages read so far. They are read again when they are touched.
  void release_pages() const;
  /// Empty for an empty file.
  [[nodiscard]] std::span<const std::byte> bytes() const {
    return {static_cast<const std::byte*>(address_), size_};
  }

 private:
  void* address_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace stillmap::maps

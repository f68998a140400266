#pragma once

#include "index/index_bytes.hpp"

#include <cstddef>
#include <filesystem>
#include <span>

namespace stillmap::localization {

/// A whole file as read-only memory; its pages are read when they are touched, and the system may
/// drop them again.
class MappedFile {
 public:
  /// @throws maps::StorageError if the file cannot be opened or mapped, maps::InputError if it is
  /// none or empty.
  explicit MappedFile(const std::filesystem::path& file);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;

  [[nodiscard]] std::span<const std::byte> bytes() const { return {address_, size_}; }

 private:
  const std::byte* address_ = nullptr;
  std::size_t size_ = 0;
};

/// `index/FORMAT-OPTIONS.idx` inside the package, where OPTIONS is a checksum of them: indices of
/// several formats and options lie side by side, and go with the map when it is moved or removed.
[[nodiscard]] std::filesystem::path index_file_of(const std::filesystem::path& package,
                                                  const MapIndexOptions& options);

/// Puts bytes at `file`, whole or not at all, and flushes them to the disk; makes its folder.
/// Several processes and threads may do so at once.
/// @throws maps::StorageError if that is not possible, also when another one is just doing it.
void publish_file(const std::filesystem::path& file, std::span<const std::byte> bytes);

}  // namespace stillmap::localization

#pragma once

#include <cstddef>
#include <filesystem>
#include <span>

namespace stillmap::maps {

/// A file as it lies on the disk, mapped for reading from its beginning to its end.
///
/// Who cuts the file off meanwhile ends the process (SIGBUS): for programs that read one file, not
/// for servers.
class MappedFile {
 public:
  /// @throws StorageError naming the file and the system's reason.
  explicit MappedFile(const std::filesystem::path& file);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;

  /// Lets go of the memory that what was read takes, which is read again where it is needed.
  void let_go() const;
  [[nodiscard]] std::span<const std::byte> span() const {
    return {static_cast<const std::byte*>(address_), bytes_};
  }

 private:
  void* address_ = nullptr;
  std::size_t bytes_ = 0;
};

}  // namespace stillmap::maps

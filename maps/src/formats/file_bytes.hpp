#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <span>

namespace stillmap::maps {

/// Content of a file; not zeroed first, since a scan is read as fast as the page cache gives it.
class FileBytes {
 public:
  FileBytes(std::unique_ptr<std::byte[]> bytes, std::size_t size)
      : bytes_(std::move(bytes)), size_(size) {}
  [[nodiscard]] std::span<const std::byte> span() const { return {bytes_.get(), size_}; }

 private:
  std::unique_ptr<std::byte[]> bytes_;
  std::size_t size_;
};

/// Reads a whole regular file. @throws StorageError naming it and the system's reason.
[[nodiscard]] FileBytes read_bytes(const std::filesystem::path& file);

}  // namespace stillmap::maps

#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>

namespace stillmap::maps {

/// A file of any size, read where it is asked for; safe from several threads. Nothing is mapped, so
/// that a file cut off meanwhile is an error and not the end of the process.
class FileReader {
 public:
  /// @param shown_as  what messages call it, where that is another. @throws StorageError naming the
  /// file and the system's reason.
  explicit FileReader(const std::filesystem::path& file,
                      const std::filesystem::path& shown_as = {});
  ~FileReader();
  FileReader(const FileReader&) = delete;
  FileReader& operator=(const FileReader&) = delete;

  [[nodiscard]] const std::filesystem::path& file() const { return file_; }
  /// When it was opened.
  [[nodiscard]] std::uint64_t size() const { return size_; }
  /// @return how many bytes there were; fewer than asked for only at the end. @throws StorageError.
  std::size_t read_at(std::uint64_t offset, std::span<std::byte> into) const;

 private:
  std::filesystem::path file_;
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
};

}  // namespace stillmap::maps

#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stillmap::server {

/// A map package as one tar that nobody ever writes: any range of it costs the bytes of that range.
///
/// manifest.json, then the files that it lists, sorted by name; owner, group and time 0. build.json
/// is left out, so that equal digests give equal bytes. For one thread at a time.
class PackageArchive {
 public:
  /// Holds the folder open and at most one file. Opens none but the manifest.
  /// @throws InputError as `MapPackage::open` for the manifest, and for names that
  /// `extract_archive` refuses; StorageError.
  /// @param without  another package: files whose bytes it has are left out.
  explicit PackageArchive(const std::filesystem::path& package,
                          const std::optional<std::filesystem::path>& without = {});
  ~PackageArchive();
  PackageArchive(const PackageArchive&) = delete;
  PackageArchive& operator=(const PackageArchive&) = delete;

  [[nodiscard]] const std::string& digest() const { return digest_; }
  /// Strong, with its quotes: of the digest and the number of this layout of the archive.
  [[nodiscard]] std::string etag() const;
  /// Bytes of the whole archive.
  [[nodiscard]] std::uint64_t size() const { return size_; }
  /// Where the bytes of a file lie in the archive.
  struct Place {
    std::uint64_t offset = 0, bytes = 0;
  };
  /// @param sha256  of the file; that of manifest.json is the package's digest. @return nothing for
  /// one that is none of the archive's.
  [[nodiscard]] std::optional<Place> place_of(std::string_view sha256) const;
  /// Fills the span from this offset on.
  /// @return its size, or less at the end of the archive only.
  /// @throws StorageError naming the file when it is gone (the version was removed meanwhile), has
  /// another size, or cannot be read.
  std::size_t read(std::uint64_t offset, std::span<char> into);

  /// Holds something as long as this: what keeps the package where it is.
  void keep(std::shared_ptr<void> pin) { pins_.push_back(std::move(pin)); }
  /// Of all files as they lie now: another text when one of them was written or replaced.
  [[nodiscard]] std::string files_state() const;
  /// Reads all files and compares them with their checksums. @return the path of the first that
  /// differs or cannot be read; empty when there is none.
  [[nodiscard]] std::string first_damaged() const;

 private:
  /// Header, bytes and padding follow each other from `offset` on.
  struct Entry {
    std::string path;
    std::uint64_t offset, header_bytes, bytes;
    std::string sha256;
  };
  void append(const std::string& path, std::uint64_t bytes, const std::string& sha256);
  std::size_t read_entry(std::size_t index, std::uint64_t from, std::span<char> into);
  void open_file(std::size_t index);
  void read_file(std::size_t index, std::uint64_t from, std::span<char> into);

  std::vector<std::shared_ptr<void>> pins_;
  std::filesystem::path package_;
  std::string digest_, without_;
  std::vector<Entry> entries_;
  std::uint64_t size_ = 0;
  int folder_ = -1;
  int file_ = -1;
  /// Which entry's file is open.
  std::size_t file_index_ = 0;
};

}  // namespace stillmap::server

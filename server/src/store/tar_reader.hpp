#pragma once

#include "store/archive.hpp"

#include <archive_entry.h>

#include <array>
#include <cstdint>
#include <exception>
#include <optional>
#include <string>
#include <string_view>

#include "store/unpacker.hpp"

namespace stillmap::server {

/// A file or folder of an archive, as it may lie on the disk.
struct TarEntry {
  /// Relative, of normal form, without a slash at its end; empty for the archive's own root.
  std::string path;
  bool is_folder = false;
  std::uint64_t bytes = 0;
};

/// The entries of a tar, checked. libarchive reads the headers, but gets the blocks one by one and
/// of each entry as many bytes as it said, so that headers are bounded, no two sizes are believed,
/// and nothing is read that is not seen here: it takes unknown types for files and a missing end
/// for one.
class TarReader {
 public:
  /// @param unpacker, limits  outlive this. @throws InputError, and what the source throws.
  TarReader(Unpacker& unpacker, std::string name, const ArchiveLimits& limits);
  TarReader(const TarReader&) = delete;
  TarReader& operator=(const TarReader&) = delete;

  /// The next entry, when all bytes of the one before were read; nothing at the end, behind which
  /// only zeros were found.
  std::optional<TarEntry> next();
  /// The next bytes of the entry, valid until the next call; empty at its end.
  std::string_view read();
  /// For messages.
  [[nodiscard]] std::string place(std::string_view path) const;

 private:
  static la_ssize_t give_for(archive* reader, void* self, const void** bytes);
  std::string_view give();
  std::string_view take(std::uint64_t most);
  std::string_view take_block();
  void check(int result, const std::string& place);
  void check_headers(const std::string& place) const;
  TarEntry checked(archive_entry* entry);
  void check_end();

  Unpacker* unpacker_;
  std::string name_;
  const ArchiveLimits* limits_;
  /// Unpacked, and not yet given to libarchive.
  std::string_view piece_;
  std::array<char, 512> block_{};
  bool in_header_ = true;
  /// The blocks of this entry's headers.
  std::string headers_;
  /// Bytes of this entry that are left, with and without padding.
  std::uint64_t padded_left_ = 0;
  std::uint64_t left_ = 0;
  std::string place_;
  std::exception_ptr thrown_;
  ArchiveReader reader_;
};

}  // namespace stillmap::server

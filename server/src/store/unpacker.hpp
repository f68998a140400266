#pragma once

#include "store/archive.hpp"

#include <archive.h>

#include <cstdint>
#include <exception>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <stillmap/maps/sha256.hpp>

namespace stillmap::server {

struct FreeArchiveReader {
  void operator()(archive* reader) const { archive_read_free(reader); }
};
using ArchiveReader = std::unique_ptr<archive, FreeArchiveReader>;

/// Undoes gzip or zstd, once, or nothing where neither is; bounded, and hashed on its way. zstd may
/// take the 128 MiB of its largest window for it.
class Unpacker {
 public:
  /// @param source, limits  outlive this. @throws InputError, and what the source throws.
  Unpacker(const ByteSource& source, std::string name, const ArchiveLimits& limits);
  Unpacker(const Unpacker&) = delete;
  Unpacker& operator=(const Unpacker&) = delete;

  /// The next unpacked bytes, valid until the next call; empty at the end, behind which the source
  /// was found to have nothing more.
  std::string_view next();
  [[nodiscard]] std::uint64_t packed_bytes() const { return packed_; }
  /// Of the packed bytes, after the end. Once only.
  [[nodiscard]] std::string sha256() { return hash_.hex(); }

 private:
  static la_ssize_t pull_for(archive* reader, void* self, const void** bytes);
  std::size_t pull();
  void check(int result);
  void check_limits() const;
  void check_end();

  const ByteSource* source_;
  std::string name_;
  const ArchiveLimits* limits_;
  std::vector<char> buffer_;
  maps::Sha256 hash_;
  std::uint64_t packed_ = 0;
  std::uint64_t unpacked_ = 0;
  bool source_ended_ = false;
  bool ended_ = false;
  /// What the source threw inside libarchive, through which nothing may be thrown.
  std::exception_ptr thrown_;
  ArchiveReader reader_;
};

}  // namespace stillmap::server

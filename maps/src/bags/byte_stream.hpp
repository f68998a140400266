#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "formats/file_reader.hpp"

namespace stillmap::maps {

/// Bytes that come one after the other.
class ByteStream {
 public:
  ByteStream() = default;
  virtual ~ByteStream() = default;
  ByteStream(const ByteStream&) = delete;
  ByteStream& operator=(const ByteStream&) = delete;

  /// @return how many bytes there were; fewer than asked for only at the end.
  /// @throws InputError for broken packed bytes, StorageError.
  virtual std::size_t read(std::span<std::byte> into) = 0;
  /// By reading, where there is no shorter way. @return how many bytes there were to skip.
  virtual std::uint64_t skip(std::uint64_t bytes);
};

/// A part of a file. What is skipped is not read.
class FileStream final : public ByteStream {
 public:
  /// @param file  outlives this. @param end  at most its size.
  FileStream(const FileReader& file, std::uint64_t begin, std::uint64_t end);
  std::size_t read(std::span<std::byte> into) override;
  std::uint64_t skip(std::uint64_t bytes) override;
  [[nodiscard]] std::uint64_t position() const { return position_; }

 private:
  const FileReader* file_;
  std::uint64_t position_;
  std::uint64_t end_;
  /// Bytes of the file from `held_from_` on.
  std::vector<std::byte> buffer_;
  std::uint64_t held_from_ = 0;
  std::size_t held_ = 0;
};

/// Undoes a compression of MCAP's, rosbag2's or ROS 1's, in pieces: memory stays below 80 MiB
/// whatever the packed bytes claim (zstd's window 64 MiB, lz4's blocks 4 MiB).
/// @param compression  "lz4" (frames), "zstd" or "bz2". @param name  for messages.
/// @throws InputError for another compression.
[[nodiscard]] std::unique_ptr<ByteStream> unpacked(std::unique_ptr<ByteStream> packed,
                                                   std::string_view compression, std::string name);

/// Bytes in memory.
class MemoryStream final : public ByteStream {
 public:
  /// @param bytes  outlive this.
  explicit MemoryStream(std::span<const std::byte> bytes) : bytes_(bytes) {}
  std::size_t read(std::span<std::byte> into) override;
  std::uint64_t skip(std::uint64_t bytes) override;

 private:
  std::span<const std::byte> bytes_;
};

}  // namespace stillmap::maps

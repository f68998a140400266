#pragma once

#include <cstdint>
#include <filesystem>

namespace stillmap::maps {

/// Whether a file is a bag that was packed as a whole (rosbag2's `compression_mode: file`): zstd by
/// its first bytes, and by its name `*.mcap.zstd`, `*.db3.zstd` or the same with `.zst`.
[[nodiscard]] bool is_packed_bag(const std::filesystem::path& file);

/// Such a bag, unpacked where its messages can be read in any order: a file without a name, beside
/// it or else where temporary files go, of which nothing stays, whatever ends the process.
class UnpackedBag {
 public:
  /// Takes at most 100 times the packed bytes (and 16 MiB).
  /// @throws InputError for broken packed bytes or more of them; StorageError when there is no
  /// room.
  explicit UnpackedBag(const std::filesystem::path& packed);
  ~UnpackedBag();
  UnpackedBag(const UnpackedBag&) = delete;
  UnpackedBag& operator=(const UnpackedBag&) = delete;

  /// A name that it has as long as this lives; who opened it by then keeps it.
  [[nodiscard]] const std::filesystem::path& file() const { return file_; }
  [[nodiscard]] std::uint64_t size() const { return size_; }

 private:
  void unpack(const std::filesystem::path& packed);
  void give_name(const std::filesystem::path& folder);

  int descriptor_ = -1;
  std::filesystem::path file_;
  std::uint64_t size_ = 0;
};

}  // namespace stillmap::maps

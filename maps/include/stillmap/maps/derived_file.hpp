#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <stdexcept>

namespace stillmap::maps {

/// A file that is made from a map and kept beside it, outside its digest. It is written as
/// `.<name>.partial`, flushed to the disk and renamed, so that it appears whole or not at all. The
/// next writer replaces what a killed writer left. While one writer works, a second is refused.
class DerivedFile {
 public:
  /// Makes the target's folder, but not those above it.
  /// @throws StorageError if it cannot be written, also while another process or thread does.
  explicit DerivedFile(std::filesystem::path target);
  /// Removes what was not published.
  ~DerivedFile();
  DerivedFile(const DerivedFile&) = delete;
  DerivedFile& operator=(const DerivedFile&) = delete;

  /// Bytes appended so far.
  [[nodiscard]] std::uint64_t size() const { return size_; }
  /// @throws StorageError, as all that follow.
  void append(std::span<const std::byte> bytes);
  /// Replaces bytes that were appended before.
  void overwrite(std::uint64_t offset, std::span<const std::byte> bytes);
  /// Fills all of `to` with what was appended. Safe from several threads while nobody writes.
  void read(std::uint64_t offset, std::span<std::byte> to) const;
  /// Once only, and last.
  void publish();

 private:
  std::filesystem::path target_;
  std::filesystem::path partial_;
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
  bool published_ = false;
};

/// How something derived is made.
struct DerivedWork {
  /// Threads to use, >= 1; the bytes do not depend on it.
  std::size_t threads = 1;
  /// Called now and then with the share that is done, in [0, 1]. Returns false to stop the work.
  /// Empty: the work is never stopped.
  std::function<bool(double share)> go_on{};
};

/// `DerivedWork::go_on` returned false; nothing was published.
class WorkStopped : public std::runtime_error {
 public:
  WorkStopped() : std::runtime_error("stopped before it was done") {}
};

}  // namespace stillmap::maps

#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string_view>

namespace stillmap::server {

/// One change to the disk, about to be made.
struct DiskCall {
  enum class Kind : std::uint8_t {
    kMakeFolder,
    kCreateFile,
    kWrite,
    kTruncate,
    kAllocate,
    kSyncFile,
    kSyncFolder,
    kRename,
    kExchange,
    kLink,
    kRemoveFile,
    kRemoveFolder,
  };
  Kind kind;
  /// Absolute.
  std::filesystem::path path;
  /// Target of a rename or of a hard link, the other one of an exchange.
  std::filesystem::path to{};
  /// Where bytes are written, or the new size when truncating or allocating.
  std::uint64_t offset = 0;
  /// What is written; valid during the call.
  std::string_view bytes{};
};

/// The one gate that every lasting change of a store passes, those of its database too. This one
/// lets all of them through; tests record them and make them fail. Safe from several threads.
class DiskCalls {
 public:
  /// Makes the change, of the first `bytes` bytes when it is a write.
  /// @return the bytes written, else 0; the negative errno when it fails.
  using Perform = std::function<std::int64_t(std::size_t bytes)>;

  DiskCalls() = default;
  virtual ~DiskCalls() = default;
  DiskCalls(const DiskCalls&) = delete;
  DiskCalls& operator=(const DiskCalls&) = delete;

  /// @return as `perform`.
  virtual std::int64_t pass(const DiskCall& call, const Perform& perform) {
    return perform(call.bytes.size());
  }
  /// Shared and without state.
  static DiskCalls& real();
};

}  // namespace stillmap::server

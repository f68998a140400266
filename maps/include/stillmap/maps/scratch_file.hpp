#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

namespace stillmap::maps {

/// Bytes that do not stay in memory: a file of its own that goes with the object.
class ScratchFile {
 public:
  /// @param folder  existing; the file there is `NAME.` and six characters.
  /// @throws StorageError naming the file, as all below.
  ScratchFile(const std::filesystem::path& folder, const std::string& name);
  ~ScratchFile();
  ScratchFile(const ScratchFile&) = delete;
  ScratchFile& operator=(const ScratchFile&) = delete;

  /// The file has no name any more: it goes with the process, even if that is killed.
  void remove_name();
  /// Not while another thread is in any other function. When it throws, nothing was appended.
  /// @return where the bytes begin.
  std::uint64_t append(const void* bytes, std::size_t size);
  /// Appends zeros that lie in memory as long as they are used: the caller unmaps them, with
  /// `munmap`. The disk keeps room for them. @param size  whole pages, in a file of such.
  /// @throws std::bad_alloc without memory.
  [[nodiscard]] void* append_mapped(std::size_t size);
  /// Safe from several threads.
  void read(std::uint64_t offset, void* bytes, std::size_t size) const;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
  bool has_name_ = true;
  int descriptor_ = -1;
  std::uint64_t end_ = 0;
};

}  // namespace stillmap::maps

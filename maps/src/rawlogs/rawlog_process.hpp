#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

namespace stillmap::maps {

/// A file without a name, gone with the last that holds it.
class UnnamedFile {
 public:
  /// In the folder for temporary files. @throws StorageError.
  UnnamedFile();
  ~UnnamedFile();
  UnnamedFile(const UnnamedFile&) = delete;
  UnnamedFile& operator=(const UnnamedFile&) = delete;

  [[nodiscard]] int descriptor() const { return descriptor_; }
  /// Reads exactly so many bytes. @return false where there are fewer. @throws StorageError.
  bool read(std::uint64_t offset, void* bytes, std::size_t size) const;
  /// @throws StorageError.
  void append(const void* bytes, std::size_t size);
  [[nodiscard]] std::uint64_t size() const { return size_; }

 private:
  std::string folder_;
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
};

/// Lets `stillmap-rawlog` read a rawlog, in a process of its own that gets no more than 256 MiB of
/// memory of its own, no file but this one, and a minute for each step; its records go to
/// `records`.
/// @return how it ended if that was not of itself: killed by what it read, or without a word for a
/// minute; otherwise nothing.
/// @throws InputError where MRPT's reader is not installed (with what to do), or when it says more
/// than a hundred times as much as it reads; StorageError.
[[nodiscard]] std::string read_rawlog(const std::filesystem::path& file, UnnamedFile& records);

/// That program, beside this one or where packages put it; empty where it is not installed.
[[nodiscard]] std::filesystem::path rawlog_program();

/// Lets it write records of kind kKeyframe as an MRPT simplemap, which it holds in memory.
/// @param go_on  asked several times a second; it is killed where that says no.
/// @return false then. @throws StorageError where it cannot be written.
[[nodiscard]] bool write_simplemap(const std::filesystem::path& program, const UnnamedFile& records,
                                   const std::filesystem::path& file,
                                   const std::function<bool()>& go_on);

}  // namespace stillmap::maps

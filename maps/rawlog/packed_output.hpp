#pragma once

#include <mrpt/io/CStream.h>
#include <zlib.h>

#include <memory>
#include <string>

namespace stillmap::maps::rawlog {

/// A file that is packed by gzip. MRPT's own does not look whether what it holds back reaches the
/// disk. What goes wrong is told by `close`: what is thrown on the way MRPT would wrap.
class PackedOutput final : public mrpt::io::CStream {
 public:
  /// @throws std::runtime_error with the system's reason.
  explicit PackedOutput(const std::string& file);

  /// What is not closed may be short. @throws std::runtime_error with the first reason.
  void close();

  size_t Write(const void* buffer, size_t size) override;
  size_t Read(void* buffer, size_t size) override;
  uint64_t Seek(int64_t offset, TSeekOrigin origin) override;
  uint64_t getTotalBytesCount() const override;
  uint64_t getPosition() const override;
  std::string getStreamDescription() const override { return "simplemap"; }

 private:
  std::unique_ptr<gzFile_s, int (*)(gzFile)> file_;
  /// Why the first write failed, as errno.
  int error_ = 0;
};

}  // namespace stillmap::maps::rawlog

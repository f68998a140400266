#pragma once

#include <mrpt/io/CStream.h>
#include <zlib.h>

#include <memory>
#include <string>

namespace stillmap::maps::rawlog {

/// A file that is packed by gzip. MRPT's own does not look whether what it holds back reaches the
/// disk.
class PackedOutput final : public mrpt::io::CStream {
 public:
  /// @throws std::runtime_error, as all of it, with the system's reason.
  explicit PackedOutput(const std::string& file);

  /// What is not closed may be short.
  void close();

  size_t Write(const void* buffer, size_t size) override;
  size_t Read(void* buffer, size_t size) override;
  uint64_t Seek(int64_t offset, TSeekOrigin origin) override;
  uint64_t getTotalBytesCount() const override;
  uint64_t getPosition() const override;
  std::string getStreamDescription() const override { return "simplemap"; }

 private:
  std::unique_ptr<gzFile_s, int (*)(gzFile)> file_;
};

}  // namespace stillmap::maps::rawlog

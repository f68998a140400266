#pragma once

#include <mrpt/io/CStream.h>
#include <zlib.h>

#include <memory>
#include <string>

namespace stillmap::maps::rawlog {

/// A file, packed by gzip or plain, that knows whether more comes.
class PackedInput final : public mrpt::io::CStream {
 public:
  /// @throws std::runtime_error if it cannot be opened.
  explicit PackedInput(const std::string& file);

  /// Whether nothing comes any more. @throws std::runtime_error if that is since it is broken off.
  [[nodiscard]] bool at_end();

  size_t Read(void* buffer, size_t size) override;
  size_t Write(const void* buffer, size_t size) override;
  uint64_t Seek(int64_t offset, TSeekOrigin origin) override;
  uint64_t getTotalBytesCount() const override;
  uint64_t getPosition() const override;
  std::string getStreamDescription() const override { return "rawlog"; }

 private:
  std::unique_ptr<gzFile_s, int (*)(gzFile)> file_;
};

}  // namespace stillmap::maps::rawlog

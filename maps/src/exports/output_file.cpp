#include "exports/output_file.hpp"

#include <stillmap/maps/error.hpp>

#include <bit>
#include <cerrno>
#include <cstring>
#include <utility>

namespace stillmap::maps {

static_assert(std::endian::native == std::endian::little, "numbers are written as they lie");

namespace {

constexpr std::size_t kBufferBytes = 1U << 20U;

}  // namespace

OutputFile::OutputFile(std::filesystem::path file)
    : file_(std::move(file)),
      buffer_(std::make_unique_for_overwrite<char[]>(kBufferBytes)),
      stream_(std::fopen(file_.c_str(), "wb")) {
  if (!stream_) fail();
  std::setvbuf(stream_.get(), buffer_.get(), _IOFBF, kBufferBytes);
}

void OutputFile::write(std::string_view bytes) {
  if (std::fwrite(bytes.data(), 1, bytes.size(), stream_.get()) != bytes.size()) fail();
}

void OutputFile::rewind() {
  if (std::fseek(stream_.get(), 0, SEEK_SET) != 0) fail();
}

void OutputFile::close() {
  // A full disk may show only when the buffer goes out.
  if (std::fclose(stream_.release()) != 0) fail();
}

void OutputFile::fail() const { throw StorageError(file_.string(), std::strerror(errno)); }

}  // namespace stillmap::maps

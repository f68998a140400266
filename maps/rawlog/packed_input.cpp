#include "packed_input.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>

namespace stillmap::maps::rawlog {

PackedInput::PackedInput(const std::string& file) : file_(::gzopen(file.c_str(), "rb"), ::gzclose) {
  if (!file_) throw std::runtime_error("cannot be opened");
  constexpr unsigned kAtOnce = 1U << 17U;
  ::gzbuffer(file_.get(), kAtOnce);
}

bool PackedInput::at_end() {
  const int byte = gzgetc(file_.get());
  if (byte >= 0) {
    ::gzungetc(byte, file_.get());
    return false;
  }
  int error = Z_OK;
  const char* const words = ::gzerror(file_.get(), &error);
  if (error != Z_OK && error != Z_STREAM_END)
    throw std::runtime_error(error == Z_BUF_ERROR ? "the file is cut off" : words);
  return true;
}

size_t PackedInput::Read(void* buffer, size_t size) {
  constexpr size_t kMost = std::numeric_limits<int>::max();
  const int count = ::gzread(file_.get(), buffer, static_cast<unsigned>(std::min(size, kMost)));
  return count < 0 ? 0 : static_cast<size_t>(count);
}

size_t PackedInput::Write(const void*, size_t) { throw std::logic_error("a rawlog is only read"); }

uint64_t PackedInput::Seek(int64_t, TSeekOrigin) {
  throw std::logic_error("a rawlog is read from its start to its end");
}

uint64_t PackedInput::getTotalBytesCount() const { return 0; }

uint64_t PackedInput::getPosition() const {
  return static_cast<uint64_t>(std::max<z_off_t>(0, ::gztell(file_.get())));
}

}  // namespace stillmap::maps::rawlog

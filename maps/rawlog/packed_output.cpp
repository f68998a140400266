#include "packed_output.hpp"

#include <algorithm>
#include <cerrno>
#include <stdexcept>
#include <system_error>

namespace stillmap::maps::rawlog {
namespace {

[[noreturn]] void fail(int error) {
  throw std::runtime_error(std::generic_category().message(error));
}

}  // namespace

PackedOutput::PackedOutput(const std::string& file)
    : file_(::gzopen(file.c_str(), "wb"), ::gzclose) {
  if (!file_) fail(errno);
}

void PackedOutput::close() {
  errno = 0;
  const bool closed = ::gzclose(file_.release()) == Z_OK;
  if (error_ != 0) fail(error_);
  if (!closed) fail(errno != 0 ? errno : EIO);
}

size_t PackedOutput::Write(const void* buffer, size_t size) {
  constexpr size_t kMost = 1U << 30U;
  const auto* from = static_cast<const char*>(buffer);
  errno = 0;
  for (size_t done = 0; done < size && error_ == 0;) {
    const int count =
        ::gzwrite(file_.get(), from + done, static_cast<unsigned>(std::min(size - done, kMost)));
    if (count <= 0) error_ = errno != 0 ? errno : EIO;
    done += static_cast<size_t>(std::max(count, 0));
  }
  return size;
}

size_t PackedOutput::Read(void*, size_t) { throw std::logic_error("a simplemap is only written"); }

uint64_t PackedOutput::Seek(int64_t, TSeekOrigin) {
  throw std::logic_error("a simplemap is written from its start to its end");
}

uint64_t PackedOutput::getTotalBytesCount() const { return getPosition(); }

uint64_t PackedOutput::getPosition() const {
  return static_cast<uint64_t>(std::max<z_off_t>(0, ::gztell(file_.get())));
}

}  // namespace stillmap::maps::rawlog

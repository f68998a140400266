#include "store/unpacker.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <cerrno>
#include <stdexcept>
#include <utility>

namespace stillmap::server {
namespace {

constexpr const char* kExpectedPacked = "a tar, plain or packed once by gzip or zstd";
constexpr std::size_t kBufferBytes = std::size_t{1} << 16U;
/// The padding alone of a tar of empty files packs by more than any sane ratio.
constexpr std::uint64_t kFreeOfRatio = std::uint64_t{16} << 20U;

ArchiveReader new_unpacking_reader() {
  ArchiveReader reader(archive_read_new());
  if (!reader || archive_read_support_format_raw(reader.get()) != ARCHIVE_OK ||
      archive_read_support_filter_gzip(reader.get()) != ARCHIVE_OK ||
      archive_read_support_filter_zstd(reader.get()) != ARCHIVE_OK) {
    throw std::runtime_error("libarchive without gzip or zstd");
  }
  return reader;
}

}  // namespace

Unpacker::Unpacker(const ByteSource& source, std::string name, const ArchiveLimits& limits)
    : source_(&source),
      name_(std::move(name)),
      limits_(&limits),
      buffer_(kBufferBytes),
      reader_(new_unpacking_reader()) {
  check(archive_read_open(reader_.get(), this, nullptr, &Unpacker::pull_for, nullptr));
  // Further layers would be undone as well, each with a ratio of its own.
  constexpr int kSourceAndOneFilter = 2;
  if (archive_filter_count(reader_.get()) > kSourceAndOneFilter)
    throw maps::InputError(name_, "packed more than once", kExpectedPacked);
  archive_entry* entry = nullptr;
  check(archive_read_next_header(reader_.get(), &entry));
}

la_ssize_t Unpacker::pull_for(archive* reader, void* self, const void** bytes) {
  auto& unpacker = *static_cast<Unpacker*>(self);
  *bytes = unpacker.buffer_.data();
  try {
    return static_cast<la_ssize_t>(unpacker.pull());
  } catch (...) {
    unpacker.thrown_ = std::current_exception();
    archive_set_error(reader, EIO, "source failed");
    return -1;
  }
}

std::size_t Unpacker::pull() {
  if (source_ended_) return 0;
  const std::size_t got = (*source_)(buffer_);
  if (got > buffer_.size()) throw std::logic_error("a byte source gave more than it was asked for");
  hash_.add(buffer_.data(), got);
  packed_ += got;
  source_ended_ = got == 0;
  return got;
}

void Unpacker::check(int result) {
  if (thrown_) std::rethrow_exception(std::exchange(thrown_, nullptr));
  if (result == ARCHIVE_OK) return;
  if (packed_ == 0) throw maps::InputError(name_, "nothing", kExpectedPacked);
  const char* reason = archive_error_string(reader_.get());
  throw maps::InputError(name_, reason ? reason : "damage", kExpectedPacked);
}

std::string_view Unpacker::next() {
  while (!ended_) {
    const void* bytes = nullptr;
    std::size_t size = 0;
    la_int64_t offset = 0;
    const int result = archive_read_data_block(reader_.get(), &bytes, &size, &offset);
    if (result == ARCHIVE_EOF) {
      check(ARCHIVE_OK);
      check_end();
      break;
    }
    check(result);
    unpacked_ += size;
    check_limits();
    if (size > 0) return {static_cast<const char*>(bytes), size};
  }
  return {};
}

void Unpacker::check_limits() const {
  if (unpacked_ > limits_->total_bytes)
    throw maps::InputError(name_, "more bytes unpacked",
                           std::to_string(limits_->total_bytes) + " at most");
  if (unpacked_ > kFreeOfRatio &&
      static_cast<double>(unpacked_) > limits_->ratio * static_cast<double>(packed_))
    throw maps::InputError(name_,
                           std::to_string(unpacked_) + " bytes out of " + std::to_string(packed_),
                           fmt::format("{} times as many at most", limits_->ratio));
}

void Unpacker::check_end() {
  ended_ = true;
  // Packed data know where they end; what follows would be hashed, but read by nobody.
  const auto used = static_cast<std::uint64_t>(archive_filter_bytes(reader_.get(), -1));
  if (used != packed_ || pull() != 0)
    throw maps::InputError(name_, "bytes behind the end of the packed data", "none");
}

}  // namespace stillmap::server

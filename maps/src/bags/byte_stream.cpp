#include "bags/byte_stream.hpp"

#include <bzlib.h>
#include <lz4frame.h>
#include <zstd.h>

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cstring>
#include <new>
#include <utility>

namespace stillmap::maps {
namespace {

/// Read ahead, in which the heads of small records lie; larger reads go past it.
constexpr std::size_t kAhead = std::size_t{8} << 10U;
constexpr std::size_t kPieceBytes = std::size_t{64} << 10U;
/// 64 MiB: what zstd's levels below 22 take, and more than any recorder's.
constexpr int kMostWindowLog = 26;

/// What lz4 and zstd share: packed bytes come in pieces, and what is skipped is unpacked as well.
class PackedStream : public ByteStream {
 public:
  PackedStream(std::unique_ptr<ByteStream> packed, std::string name)
      : packed_(std::move(packed)), name_(std::move(name)), input_(kPieceBytes) {}

  std::size_t read(std::span<std::byte> into) final {
    std::size_t done = 0;
    while (done < into.size()) {
      if (begin_ == end_ && !ended_) refill();
      const std::size_t begin = begin_;
      const std::size_t got = unpack(into.subspan(done));
      done += got;
      if (got > 0 || begin_ > begin) continue;
      if (begin_ < end_) refuse("no way on");
      if (ended_) break;
    }
    return done;
  }

 protected:
  [[nodiscard]] std::span<const std::byte> input() const {
    return std::span(input_).subspan(begin_, end_ - begin_);
  }
  void used(std::size_t bytes) { begin_ += bytes; }
  [[noreturn]] void refuse(const char* reason) const {
    throw InputError(name_, std::string("packed bytes with: ") + reason,
                     "whole ones: copy the file again");
  }

 private:
  /// @return bytes written; takes from `input()` by `used`.
  virtual std::size_t unpack(std::span<std::byte> into) = 0;
  void refill() {
    begin_ = 0;
    end_ = packed_->read(input_);
    ended_ = end_ < input_.size();
  }

  std::unique_ptr<ByteStream> packed_;
  std::string name_;
  std::vector<std::byte> input_;
  std::size_t begin_ = 0;
  std::size_t end_ = 0;
  bool ended_ = false;
};

class Lz4Stream final : public PackedStream {
 public:
  Lz4Stream(std::unique_ptr<ByteStream> packed, std::string name)
      : PackedStream(std::move(packed), std::move(name)) {
    if (LZ4F_isError(LZ4F_createDecompressionContext(&context_, LZ4F_VERSION)) != 0)
      throw std::bad_alloc();
  }
  ~Lz4Stream() override { LZ4F_freeDecompressionContext(context_); }
  Lz4Stream(const Lz4Stream&) = delete;
  Lz4Stream& operator=(const Lz4Stream&) = delete;

 private:
  std::size_t unpack(std::span<std::byte> into) override {
    std::size_t written = into.size();
    std::size_t taken = input().size();
    const std::size_t result =
        LZ4F_decompress(context_, into.data(), &written, input().data(), &taken, nullptr);
    if (LZ4F_isError(result) != 0) refuse(LZ4F_getErrorName(result));
    used(taken);
    return written;
  }

  LZ4F_dctx* context_ = nullptr;
};

class ZstdStream final : public PackedStream {
 public:
  ZstdStream(std::unique_ptr<ByteStream> packed, std::string name)
      : PackedStream(std::move(packed), std::move(name)), context_(ZSTD_createDCtx()) {
    if (context_ == nullptr) throw std::bad_alloc();
    ZSTD_DCtx_setParameter(context_, ZSTD_d_windowLogMax, kMostWindowLog);
  }
  ~ZstdStream() override { ZSTD_freeDCtx(context_); }
  ZstdStream(const ZstdStream&) = delete;
  ZstdStream& operator=(const ZstdStream&) = delete;

 private:
  std::size_t unpack(std::span<std::byte> into) override {
    ZSTD_outBuffer out{into.data(), into.size(), 0};
    ZSTD_inBuffer in{input().data(), input().size(), 0};
    const std::size_t result = ZSTD_decompressStream(context_, &out, &in);
    if (ZSTD_isError(result) != 0) refuse(ZSTD_getErrorName(result));
    used(in.pos);
    return out.pos;
  }

  ZSTD_DCtx* context_;
};

/// bzip2, as ROS 1 packs chunks.
class Bz2Stream final : public PackedStream {
 public:
  Bz2Stream(std::unique_ptr<ByteStream> packed, std::string name)
      : PackedStream(std::move(packed), std::move(name)) {
    if (BZ2_bzDecompressInit(&stream_, 0, 0) != BZ_OK) throw std::bad_alloc();
  }
  ~Bz2Stream() override { BZ2_bzDecompressEnd(&stream_); }
  Bz2Stream(const Bz2Stream&) = delete;
  Bz2Stream& operator=(const Bz2Stream&) = delete;

 private:
  std::size_t unpack(std::span<std::byte> into) override {
    // What follows the end is nothing of ours.
    if (at_end_) {
      used(input().size());
      return 0;
    }
    constexpr std::size_t kMost = std::size_t{1} << 30U;
    const std::span<const std::byte> packed = input();
    const auto given = static_cast<unsigned>(std::min(packed.size(), kMost));
    const auto room = static_cast<unsigned>(std::min(into.size(), kMost));
    // It reads from this pointer only.
    stream_.next_in = const_cast<char*>(reinterpret_cast<const char*>(packed.data()));
    stream_.avail_in = given;
    stream_.next_out = reinterpret_cast<char*>(into.data());
    stream_.avail_out = room;
    const int result = BZ2_bzDecompress(&stream_);
    at_end_ = result == BZ_STREAM_END;
    if (result != BZ_OK && !at_end_) refuse("bytes that are no bzip2");
    used(given - stream_.avail_in);
    return room - stream_.avail_out;
  }

  bz_stream stream_{};
  bool at_end_ = false;
};

}  // namespace

std::uint64_t ByteStream::skip(std::uint64_t bytes) {
  std::vector<std::byte> sink(
      static_cast<std::size_t>(std::min<std::uint64_t>(bytes, kPieceBytes)));
  std::uint64_t done = 0;
  while (done < bytes) {
    const auto wanted =
        static_cast<std::size_t>(std::min<std::uint64_t>(bytes - done, sink.size()));
    const std::size_t got = read(std::span(sink).first(wanted));
    done += got;
    if (got < wanted) break;
  }
  return done;
}

FileStream::FileStream(const FileReader& file, std::uint64_t begin, std::uint64_t end)
    : file_(&file), position_(begin), end_(std::max(begin, end)) {}

std::size_t FileStream::read(std::span<std::byte> into) {
  into =
      into.first(static_cast<std::size_t>(std::min<std::uint64_t>(into.size(), end_ - position_)));
  std::size_t done = 0;
  while (done < into.size()) {
    if (position_ >= held_from_ && position_ < held_from_ + held_) {
      const auto from = static_cast<std::size_t>(position_ - held_from_);
      const std::size_t size = std::min(held_ - from, into.size() - done);
      std::memcpy(into.data() + done, buffer_.data() + from, size);
      done += size;
      position_ += size;
      continue;
    }
    const std::span<std::byte> rest = into.subspan(done);
    if (rest.size() >= kAhead) {
      const std::size_t got = file_->read_at(position_, rest);
      position_ += got;
      return done + got;
    }
    buffer_.resize(kAhead);
    held_from_ = position_;
    held_ = file_->read_at(position_, buffer_);
    if (held_ == 0) break;
  }
  return done;
}

std::uint64_t FileStream::skip(std::uint64_t bytes) {
  const std::uint64_t skipped = std::min(bytes, end_ - position_);
  position_ += skipped;
  return skipped;
}

std::size_t MemoryStream::read(std::span<std::byte> into) {
  const std::size_t size = std::min(into.size(), bytes_.size());
  if (size > 0) std::memcpy(into.data(), bytes_.data(), size);
  bytes_ = bytes_.subspan(size);
  return size;
}

std::uint64_t MemoryStream::skip(std::uint64_t bytes) {
  const auto size = static_cast<std::size_t>(std::min<std::uint64_t>(bytes, bytes_.size()));
  bytes_ = bytes_.subspan(size);
  return size;
}

std::unique_ptr<ByteStream> unpacked(std::unique_ptr<ByteStream> packed,
                                     std::string_view compression, std::string name) {
  if (compression == "lz4") return std::make_unique<Lz4Stream>(std::move(packed), std::move(name));
  if (compression == "zstd")
    return std::make_unique<ZstdStream>(std::move(packed), std::move(name));
  if (compression == "bz2") return std::make_unique<Bz2Stream>(std::move(packed), std::move(name));
  throw InputError(name, "compression '" + std::string(compression.substr(0, 32)) + "'",
                   "none, lz4, zstd or bz2: convert the bag to one of these");
}

}  // namespace stillmap::maps

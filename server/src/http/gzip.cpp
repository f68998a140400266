#include "http/gzip.hpp"

#include <array>
#include <memory>
#include <new>

namespace stillmap::server {

Gunzip::Gunzip() {
  constexpr int kGzipOnly = 16 + MAX_WBITS;
  if (inflateInit2(&stream_, kGzipOnly) != Z_OK) throw std::bad_alloc();
}

Gunzip::~Gunzip() { inflateEnd(&stream_); }

void Gunzip::unpack(std::span<const char> piece, std::size_t most, std::string& to) {
  std::array<char, 16384> unpacked;
  // zlib does not write to what it reads.
  stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(piece.data()));
  stream_.avail_in = static_cast<uInt>(piece.size());
  if (state_ == Z_STREAM_END && !piece.empty()) state_ = Z_DATA_ERROR;
  while (state_ == Z_OK && to.size() <= most) {
    stream_.next_out = reinterpret_cast<Bytef*>(unpacked.data());
    stream_.avail_out = static_cast<uInt>(unpacked.size());
    state_ = inflate(&stream_, Z_NO_FLUSH);
    to.append(unpacked.data(), unpacked.size() - stream_.avail_out);
    if (state_ == Z_STREAM_END && stream_.avail_in > 0) state_ = Z_DATA_ERROR;
  }
  // No more input: the next piece goes on.
  if (state_ == Z_BUF_ERROR && stream_.avail_in == 0) state_ = Z_OK;
}

std::string pack_gzip(std::string_view bytes) {
  constexpr int kGzip = 16 + MAX_WBITS;
  constexpr int kUsualMemory = 8;
  z_stream stream{};
  if (deflateInit2(&stream, Z_DEFAULT_COMPRESSION, Z_DEFLATED, kGzip, kUsualMemory,
                   Z_DEFAULT_STRATEGY) != Z_OK)
    throw std::bad_alloc();
  const std::unique_ptr<z_stream, decltype(&deflateEnd)> owner(&stream, deflateEnd);
  std::string packed(deflateBound(&stream, static_cast<uLong>(bytes.size())), '\0');
  // zlib does not write to what it reads.
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  if (deflate(&stream, Z_FINISH) != Z_STREAM_END) throw std::bad_alloc();
  packed.resize(stream.total_out);
  return packed;
}

}  // namespace stillmap::server

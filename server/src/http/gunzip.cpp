#include "http/gunzip.hpp"

#include <array>
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

}  // namespace stillmap::server

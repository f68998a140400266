#pragma once

#include <zlib.h>

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

namespace stillmap::server {

/// Unpacks one gzip member that comes in pieces, RFC 1952.
class Gunzip {
 public:
  Gunzip();
  ~Gunzip();
  Gunzip(const Gunzip&) = delete;
  Gunzip& operator=(const Gunzip&) = delete;

  /// Appends what the piece unpacks to, and stops soon after `to` has more than `most` bytes.
  void unpack(std::span<const char> piece, std::size_t most, std::string& to);
  /// Whether the member ended, its checksum fits and nothing came after it.
  [[nodiscard]] bool is_complete() const { return state_ == Z_STREAM_END; }

 private:
  z_stream stream_{};
  int state_ = Z_OK;
};

/// @return the bytes as one gzip member.
[[nodiscard]] std::string pack_gzip(std::string_view bytes);

}  // namespace stillmap::server

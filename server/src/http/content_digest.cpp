#include "http/content_digest.hpp"

#include "errors/api_error.hpp"
#include "http/base64.hpp"

#include <cstddef>
#include <stdexcept>
#include <string_view>

namespace stillmap::server {
namespace {

constexpr std::size_t kSha256Bytes = 32;
constexpr std::size_t kBase64Bytes = 44;  // of 32 bytes: 43 and one "="
constexpr std::string_view kHex = "0123456789abcdef";

ApiError unreadable(const std::string& text) {
  return field_error(ErrorCode::kInvalidRequest, "Content-Digest", "'" + text + "'",
                     "sha-256=:BASE64: of the body");
}

/// @param base64  44 characters.
std::optional<std::string> hex_of(std::string_view base64) {
  const std::optional<std::string> bytes = from_base64(base64);
  if (!bytes || bytes->size() != kSha256Bytes) return std::nullopt;
  std::string hex;
  for (const char each : *bytes) {
    const auto byte = static_cast<unsigned char>(each);
    hex += kHex[byte >> 4U];
    hex += kHex[byte & 15U];
  }
  return hex;
}

}  // namespace

std::optional<std::string> wanted_sha256(const HttpRequest& request) {
  const std::string text = request.header("content-digest");
  if (text.empty()) return std::nullopt;
  constexpr std::string_view kName = "sha-256=:";
  const std::size_t begin = text.find(kName);
  if (begin == std::string::npos) throw unreadable(text);
  const std::size_t from = begin + kName.size();
  const std::size_t end = text.find(':', from);
  if (end == std::string::npos || end - from != kBase64Bytes) throw unreadable(text);
  auto hex = hex_of(std::string_view(text).substr(from, kBase64Bytes));
  if (!hex) throw unreadable(text);
  return hex;
}

std::string content_digest_of(const std::string& sha256_hex) {
  std::string bytes;
  if (sha256_hex.size() != 2 * kSha256Bytes) throw std::invalid_argument("a SHA-256 in hex");
  for (std::size_t i = 0; i < kSha256Bytes; ++i) {
    const std::size_t high = kHex.find(sha256_hex[2 * i]);
    const std::size_t low = kHex.find(sha256_hex[2 * i + 1]);
    if (high == std::string_view::npos || low == std::string_view::npos)
      throw std::invalid_argument("a SHA-256 in hex");
    bytes += static_cast<char>(high * 16 + low);
  }
  return "sha-256=:" + to_base64(bytes) + ":";
}

}  // namespace stillmap::server

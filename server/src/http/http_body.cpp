#include "http/http_body.hpp"

#include "errors/api_error.hpp"
#include "http/gzip.hpp"
#include "http/header_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <limits>
#include <utility>

namespace stillmap::server {
namespace {

/// What scans take: smaller bodies cost little.
constexpr std::size_t kLeastSpareBytes = std::size_t{64} << 10U;

ApiError too_large(const std::string& found, std::uint64_t most) {
  return field_error(ErrorCode::kPayloadTooLarge, "body", found, fmt::format("at most {}", most));
}

/// @return empty for a body as it is.
std::string content_encoding(const RequestHead& head) {
  const std::string encoding = lower(head.value("content-encoding"));
  return encoding == "identity" ? std::string{} : encoding;
}

}  // namespace

std::size_t SocketBody::read(std::span<char> to) {
  const auto most = static_cast<std::size_t>(std::min<std::uint64_t>(left_, to.size()));
  if (most == 0) return 0;
  const long got = socket_.read(to.data(), most);
  if (got <= 0) {
    throw ApiError(ErrorCode::kInvalidRequest, "the body ends early or comes too slowly");
  }
  left_ -= static_cast<std::uint64_t>(got);
  return static_cast<std::size_t>(got);
}

std::optional<std::uint64_t> announced_length(const RequestHead& head) {
  if (head.count("content-length") == 0) return std::nullopt;
  const std::string text = head.value("content-length");
  std::uint64_t length = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), length);
  if (end != text.data() + text.size() || error == std::errc::invalid_argument) {
    throw field_error(ErrorCode::kInvalidRequest, "Content-Length", "'" + text + "'", "one number");
  }
  if (error != std::errc{}) return std::numeric_limits<std::uint64_t>::max();
  return length;
}

std::size_t most_whole_bytes(const RequestHead& head, const Route& route,
                             const WholeBodyLimits& limits) {
  const bool is_json = media_type(head.value("content-type")) == "application/json";
  const std::size_t most = is_json ? limits.json_bytes : limits.bytes;
  if (route.max_body_bytes == 0) return most;
  return static_cast<std::size_t>(std::min<std::uint64_t>(route.max_body_bytes, most));
}

void check_body(const RequestHead& head, std::optional<std::uint64_t> length, const Route& route,
                const WholeBodyLimits& limits) {
  if (route.body == BodyKind::kNone) return;
  const bool is_announced = length || head.count("transfer-encoding") > 0;
  if (!is_announced && route.body_is_optional) return;
  // A body whose length is not known could not be refused before it is there.
  if (!length) {
    throw ApiError(ErrorCode::kLengthRequired, "send Content-Length; chunks are not taken");
  }
  const bool whole = route.body == BodyKind::kWhole;
  const std::uint64_t most = whole ? most_whole_bytes(head, route, limits) : route.max_body_bytes;
  if (*length > most) throw too_large(fmt::format("{} bytes", *length), most);
  // What is streamed carries its own packing.
  const std::string encoding = content_encoding(head);
  if (!encoding.empty() && !(whole && encoding == "gzip")) {
    throw field_error(ErrorCode::kUnsupportedMediaType, "Content-Encoding", "'" + encoding + "'",
                      whole ? "gzip or identity" : "none");
  }
}

std::string SpareBodies::take(std::uint64_t bytes) {
  const std::scoped_lock lock(mutex_);
  if (bytes < kLeastSpareBytes || spare_.empty()) return {};
  std::string body = std::move(spare_.back());
  spare_.pop_back();
  return body;
}

void SpareBodies::give(std::string&& body) {
  constexpr std::size_t kMostSpareBytes = std::size_t{4} << 20U;
  constexpr std::size_t kMostSpare = 8;
  const std::scoped_lock lock(mutex_);
  if (body.capacity() < kLeastSpareBytes || body.capacity() > kMostSpareBytes ||
      spare_.size() >= kMostSpare)
    return;
  spare_.push_back(std::move(body));
}

std::string read_whole(SocketBody& body, const RequestHead& head, std::size_t most,
                       std::string&& room) {
  std::string whole = std::move(room);
  if (content_encoding(head).empty()) {
    constexpr std::size_t kPiece = std::size_t{1} << 20U;
    const auto size = static_cast<std::size_t>(body.size());
    // Memory that is not touched is not taken: what is only announced costs nothing.
    whole.reserve(size);
    // What was there before is not cleared: all of it is overwritten.
    if (whole.size() > size) whole.resize(size);
    for (std::size_t filled = 0; !body.is_read();) {
      if (filled == whole.size()) whole.resize(std::min(size, filled + kPiece));
      filled += body.read(std::span(whole).subspan(filled));
    }
    return whole;
  }
  whole.clear();
  std::array<char, 16384> piece;
  Gunzip gunzip;
  while (const std::size_t count = body.read(piece)) {
    gunzip.unpack(std::span(piece).first(count), most, whole);
    if (whole.size() > most) throw too_large("more bytes", most);
  }
  if (!gunzip.is_complete()) {
    throw ApiError(ErrorCode::kInvalidRequest, "the body cannot be unpacked as gzip");
  }
  return whole;
}

}  // namespace stillmap::server

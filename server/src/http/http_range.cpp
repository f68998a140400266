#include "http/http_range.hpp"

#include "errors/api_error.hpp"
#include "http/header_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <string>

namespace stillmap::server {
namespace {

ApiError unreadable() {
  return {ErrorCode::kRangeNotSatisfiable, "one range is served, such as bytes=0-99"};
}

std::optional<std::uint64_t> number_in(std::string_view text) {
  if (text.empty()) return std::nullopt;
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) throw unreadable();
  return value;
}

std::string_view without_weakness(std::string_view tag) {
  return tag.starts_with("W/") ? tag.substr(2) : tag;
}

}  // namespace

std::optional<ByteRange> parse_range(std::string_view header) {
  constexpr std::string_view kUnit = "bytes=";
  if (!lower(header.substr(0, kUnit.size())).starts_with(kUnit)) return std::nullopt;
  const std::string_view text = trimmed(header.substr(kUnit.size()));
  const std::size_t dash = text.find('-');
  if (dash == std::string_view::npos) throw unreadable();
  const ByteRange range{number_in(text.substr(0, dash)), number_in(text.substr(dash + 1))};
  if (!range.first && !range.last) throw unreadable();
  if (range.first && range.last && *range.first > *range.last) throw unreadable();
  return range;
}

BodyPart part_of(const ByteRange& range, std::uint64_t size) {
  const std::uint64_t first =
      range.first ? *range.first : size - std::min(size, range.last.value_or(0));
  if (first >= size) {
    throw ApiError(ErrorCode::kRangeNotSatisfiable, "the range lies beyond the body")
        .with_header("Content-Range", fmt::format("bytes */{}", size));
  }
  const std::uint64_t last = range.first && range.last ? std::min(*range.last, size - 1) : size - 1;
  return {first, last - first + 1};
}

bool lists_tag(std::string_view if_none_match, std::string_view etag) {
  if (trimmed(if_none_match) == "*") return true;
  const std::string_view wanted = without_weakness(etag);
  // Between quotes stands no quote, RFC 9110, 8.8.3.
  for (std::size_t begin = if_none_match.find('"'); begin != std::string_view::npos;) {
    const std::size_t end = if_none_match.find('"', begin + 1);
    if (end == std::string_view::npos) return false;
    if (if_none_match.substr(begin, end - begin + 1) == wanted) return true;
    begin = if_none_match.find('"', end + 1);
  }
  return false;
}

}  // namespace stillmap::server

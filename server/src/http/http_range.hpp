#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace stillmap::server {

/// First and last byte as a client asks for them; a last one alone is a count from the end.
struct ByteRange {
  std::optional<std::uint64_t> first;
  std::optional<std::uint64_t> last;
};

/// A part of a body.
struct BodyPart {
  std::uint64_t first = 0;
  std::uint64_t size = 0;
};

/// @param header  the Range header. @return nothing when it is empty or not in bytes.
/// @throws ApiError kRangeNotSatisfiable when it is no range, or more than one: many overlapping
/// ones are a known way to make a server send a body thousands of times (RFC 9110, 14.2).
[[nodiscard]] std::optional<ByteRange> parse_range(std::string_view header);

/// @throws ApiError kRangeNotSatisfiable when it lies outside of a body of `size` bytes.
[[nodiscard]] BodyPart part_of(const ByteRange& range, std::uint64_t size);

/// Whether one of the tags in an If-None-Match header is `etag`, weakly compared; `*` is any.
[[nodiscard]] bool lists_tag(std::string_view if_none_match, std::string_view etag);

}  // namespace stillmap::server

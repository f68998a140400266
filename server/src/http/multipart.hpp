#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// One part of a `multipart/form-data` body; `content` lies in the body.
struct MultipartPart {
  std::string name;
  /// Empty when not said.
  std::string content_type;
  std::string_view content;
};

/// Splits a body (RFC 7578), in time linear in its size. The HTTP library's own splitter runs
/// recursive regular expressions over lines of any length, so bytes from outside could exhaust its
/// stack.
/// @param content_type  the request's, with the boundary.
/// @param most_parts    more are refused.
/// @throws ApiError kInvalidRequest when it is malformed or has more parts.
[[nodiscard]] std::vector<MultipartPart> split_multipart(std::string_view content_type,
                                                         std::string_view body,
                                                         std::size_t most_parts = 4);

}  // namespace stillmap::server

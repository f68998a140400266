#include "http/multipart.hpp"

#include "errors/api_error.hpp"
#include "http/header_text.hpp"

#include <fmt/format.h>

namespace stillmap::server {
namespace {

constexpr std::size_t kMaxPartHeaderBytes = 4096;

ApiError malformed(const std::string& found, const std::string& expected) {
  return field_error(ErrorCode::kInvalidRequest, "multipart body", found, expected);
}

/// Reads the part's header lines and takes them off its front.
MultipartPart read_part(std::string_view part) {
  const std::size_t end = part.substr(0, kMaxPartHeaderBytes).find("\r\n\r\n");
  if (end == std::string_view::npos)
    throw malformed("a part without an end of its header", "an empty line");
  MultipartPart result;
  result.content = part.substr(end + 4);
  std::string_view header = part.substr(0, end);
  while (!header.empty()) {
    const std::size_t line_end = header.find("\r\n");
    const std::string_view line = header.substr(0, line_end);
    header.remove_prefix(line_end == std::string_view::npos ? header.size() : line_end + 2);
    const std::size_t colon = line.find(':');
    if (colon == std::string_view::npos)
      throw malformed("a header line without a colon", "name: value");
    const std::string name = lower(trimmed(line.substr(0, colon)));
    if (name == "content-disposition") result.name = parameter_of(line.substr(colon + 1), "name");
    if (name == "content-type") result.content_type = media_type(line.substr(colon + 1));
  }
  if (result.name.empty())
    throw malformed("a part without a name", "Content-Disposition with a name");
  return result;
}

}  // namespace

std::vector<MultipartPart> split_multipart(std::string_view content_type, std::string_view body,
                                           std::size_t most_parts) {
  const std::string boundary = parameter_of(content_type, "boundary");
  if (boundary.empty() || boundary.size() > 70) {
    throw field_error(ErrorCode::kInvalidRequest, "Content-Type", "no usable boundary",
                      "a boundary of 1 to 70 characters");
  }
  const std::string delimiter = "\r\n--" + boundary;
  if (!body.starts_with(std::string_view(delimiter).substr(2))) {
    throw malformed("another start", "the boundary of the Content-Type");
  }
  body.remove_prefix(delimiter.size() - 2);
  std::vector<MultipartPart> parts;
  while (!body.starts_with("--")) {
    if (!body.starts_with("\r\n"))
      throw malformed("other bytes after a boundary", "a line end or --");
    body.remove_prefix(2);
    const std::size_t end = body.find(delimiter);
    if (end == std::string_view::npos) throw malformed("no closing boundary", "one");
    if (parts.size() == most_parts) {
      throw malformed(fmt::format("more than {} parts", most_parts), "request and scans");
    }
    parts.push_back(read_part(body.substr(0, end)));
    body.remove_prefix(end + delimiter.size());
  }
  return parts;
}

}  // namespace stillmap::server

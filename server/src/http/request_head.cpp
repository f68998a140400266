#include "http/request_head.hpp"

#include "errors/api_error.hpp"
#include "http/header_text.hpp"

#include <algorithm>

namespace stillmap::server {
namespace {

[[noreturn]] void refuse_head(const std::string& why) {
  throw ApiError(ErrorCode::kInvalidRequest, "the request is not understood as HTTP/1.1: " + why);
}

/// RFC 9110, 5.6.2.
bool is_token(std::string_view text) {
  constexpr std::string_view kMarks = "!#$%&'*+-.^_`|~";
  const auto allowed = [&](char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
           kMarks.find(c) != std::string_view::npos;
  };
  return !text.empty() && std::all_of(text.begin(), text.end(), allowed);
}

bool is_control(char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }

/// Takes the next line off `rest`. Only "\r\n" ends one.
std::string_view next_line(std::string_view& rest) {
  const std::size_t end = rest.find('\n');
  if (end == std::string_view::npos || end == 0 || rest[end - 1] != '\r')
    refuse_head("a bare line feed");
  const std::string_view line = rest.substr(0, end - 1);
  rest.remove_prefix(end + 1);
  if (line.find('\r') != std::string_view::npos) refuse_head("a bare carriage return");
  return line;
}

/// "http://host/path", which every server has to take, means "/path".
std::string_view without_authority(std::string_view target) {
  for (const std::string_view scheme : {"http://", "https://"}) {
    if (!lower(target.substr(0, scheme.size())).starts_with(scheme)) continue;
    const std::size_t path = target.find('/', scheme.size());
    return path == std::string_view::npos ? "/" : target.substr(path);
  }
  return target;
}

void parse_request_line(std::string_view line, RequestHead& head) {
  const std::size_t first = line.find(' ');
  const std::size_t last = line.rfind(' ');
  if (first == std::string_view::npos || first == last) refuse_head("the request line");
  head.method = line.substr(0, first);
  head.target = without_authority(line.substr(first + 1, last - first - 1));
  const std::string_view version = line.substr(last + 1);
  if (!is_token(head.method)) refuse_head("the method");
  const auto unfit = [](char c) { return is_control(c) || c == ' '; };
  if ((!head.target.starts_with('/') && head.target != "*") ||
      std::any_of(head.target.begin(), head.target.end(), unfit)) {
    refuse_head("the target");
  }
  if (version != "HTTP/1.1" && version != "HTTP/1.0") refuse_head("the version");
  head.old_version = version == "HTTP/1.0";
}

void parse_field(std::string_view line, RequestHead& head) {
  const std::size_t colon = line.find(':');
  if (colon == std::string_view::npos || !is_token(line.substr(0, colon))) {
    refuse_head("the name of a header");
  }
  const std::string_view value = trimmed(line.substr(colon + 1));
  const auto unfit = [](char c) { return is_control(c) && c != '\t'; };
  if (std::any_of(value.begin(), value.end(), unfit))
    refuse_head("a control character in a header");
  head.fields.emplace_back(lower(line.substr(0, colon)), value);
}

void check_framing(const RequestHead& head) {
  const std::size_t lengths = head.count("content-length");
  if (lengths > 1) refuse_head("more than one Content-Length");
  if (lengths > 0 && head.count("transfer-encoding") > 0) {
    refuse_head("both Content-Length and Transfer-Encoding");
  }
  const std::size_t hosts = head.count("host");
  if (hosts > 1 || (hosts == 0 && !head.old_version)) refuse_head("not one Host");
}

}  // namespace

std::size_t RequestHead::count(std::string_view name) const {
  return static_cast<std::size_t>(std::count_if(
      fields.begin(), fields.end(), [&](const auto& field) { return field.first == name; }));
}

std::string RequestHead::value(std::string_view name) const {
  const auto found = std::find_if(fields.begin(), fields.end(),
                                  [&](const auto& field) { return field.first == name; });
  return found == fields.end() ? std::string{} : found->second;
}

bool RequestHead::wants_close() const {
  const std::string wish = lower(value("connection"));
  if (wish.find("close") != std::string::npos) return true;
  return old_version && wish.find("keep-alive") == std::string::npos;
}

RequestHead parse_head(std::string_view head) {
  RequestHead result;
  parse_request_line(next_line(head), result);
  for (std::string_view line = next_line(head); !line.empty(); line = next_line(head)) {
    parse_field(line, result);
  }
  check_framing(result);
  return result;
}

}  // namespace stillmap::server

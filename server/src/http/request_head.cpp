#include "http/request_head.hpp"

#include "errors/api_error.hpp"
#include "http/header_text.hpp"

#include <algorithm>
#include <array>

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

/// Takes the host off "http://host/path", which every server has to take and which means "/path".
/// @return the host; empty when the target has none.
std::string_view take_authority(std::string_view& target) {
  for (const std::string_view scheme : {"http://", "https://"}) {
    if (!lower(target.substr(0, scheme.size())).starts_with(scheme)) continue;
    const std::size_t begin = scheme.size();
    const std::size_t end = std::min(target.find_first_of("/?", begin), target.size());
    const std::string_view authority = target.substr(begin, end - begin);
    if (authority.empty()) refuse_head("a target without a host");
    target = end == target.size() ? "/" : target.substr(end);
    return authority;
  }
  return {};
}

/// Proxies differ in whether they decode these before they compare paths with their rules.
bool has_encoded_separator(std::string_view target) {
  const std::string path = lower(target.substr(0, target.find('?')));
  return path.find("%2f") != std::string::npos || path.find("%5c") != std::string::npos;
}

/// @return the host in the target, if there is one.
std::string parse_request_line(std::string_view line, RequestHead& head) {
  const std::size_t first = line.find(' ');
  const std::size_t last = line.rfind(' ');
  if (first == std::string_view::npos || first == last) refuse_head("the request line");
  head.method = line.substr(0, first);
  std::string_view target = line.substr(first + 1, last - first - 1);
  std::string authority(take_authority(target));
  head.target = target;
  const std::string_view version = line.substr(last + 1);
  if (!is_token(head.method)) refuse_head("the method");
  const auto unfit = [](char c) { return is_control(c) || c == ' '; };
  if ((!head.target.starts_with('/') && head.target != "*") ||
      std::any_of(head.target.begin(), head.target.end(), unfit)) {
    refuse_head("the target");
  }
  if (has_encoded_separator(head.target))
    refuse_head("an encoded slash or backslash in the path; send it as it is, or leave it out");
  if (version != "HTTP/1.1" && version != "HTTP/1.0") refuse_head("the version");
  head.old_version = version == "HTTP/1.0";
  return authority;
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

/// Headers that the server acts on and that may stand once: of two, another reader might take the
/// other one.
constexpr std::array<std::string_view, 15> kOnce = {
    "authorization", "content-digest",  "content-encoding", "content-length",
    "content-type",  "expect",          "if-match",         "if-none-match",
    "if-range",      "idempotency-key", "last-event-id",    "origin",
    "range",         "sec-fetch-site",  "stillmap-seal"};

/// @param authority  the host in the target; empty when it has none.
void check_fields(const RequestHead& head, const std::string& authority) {
  for (const std::string_view name : kOnce)
    if (head.count(name) > 1) refuse_head("more than one " + std::string(name));
  if (head.count("content-length") > 0 && head.count("transfer-encoding") > 0) {
    refuse_head("both Content-Length and Transfer-Encoding");
  }
  const std::size_t hosts = head.count("host");
  if (hosts > 1 || (hosts == 0 && !head.old_version)) refuse_head("not one Host");
  // RFC 9112, 3.2.2 has the target's host count; a proxy may have gone by the other.
  if (!authority.empty() && lower(authority) != lower(head.value("host")))
    refuse_head("a target whose host is not that of Host");
}

}  // namespace

std::size_t RequestHead::count(std::string_view name) const {
  return static_cast<std::size_t>(std::count_if(
      fields.begin(), fields.end(), [&](const auto& field) { return field.first == name; }));
}

std::vector<std::string> RequestHead::values(std::string_view name) const {
  std::vector<std::string> values;
  for (const auto& [key, value] : fields)
    if (key == name) values.push_back(value);
  return values;
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
  const std::string authority = parse_request_line(next_line(head), result);
  for (std::string_view line = next_line(head); !line.empty(); line = next_line(head)) {
    parse_field(line, result);
  }
  check_fields(result, authority);
  return result;
}

}  // namespace stillmap::server

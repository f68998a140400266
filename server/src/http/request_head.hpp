#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stillmap::server {

/// The head of an HTTP/1.1 request as it came, nothing decoded.
struct RequestHead {
  std::string method;
  /// Begins with '/' ("*" of OPTIONS too is a target, of which nothing is served).
  std::string target;
  /// Whether it is HTTP/1.0, where a connection ends after one answer unless it is kept by name.
  bool old_version = false;
  /// Names in lower case, values without the blanks around them, in their order.
  std::vector<std::pair<std::string, std::string>> fields;

  [[nodiscard]] std::size_t count(std::string_view name) const;
  /// @return the first value; empty when there is none. @param name  in lower case.
  [[nodiscard]] std::string value(std::string_view name) const;
  /// All of them, in their order.
  [[nodiscard]] std::vector<std::string> values(std::string_view name) const;
  /// Whether the client wants the connection to end after the answer.
  [[nodiscard]] bool wants_close() const;
};

/// Reads a head as RFC 9112 has it. Whatever two readers could take for different requests is
/// refused, since a proxy in front might be the other reader: bare line feeds, folded lines, blanks
/// before a colon, control characters, a body length next to a transfer coding, no or two hosts,
/// another host in the target, encoded slashes in its path, and twice one of the headers that the
/// server acts on.
/// @param head  from the request line up to and including the empty line.
/// @throws ApiError kInvalidRequest.
[[nodiscard]] RequestHead parse_head(std::string_view head);

}  // namespace stillmap::server

#pragma once

#include <string>
#include <string_view>

namespace stillmap::server {

[[nodiscard]] std::string lower(std::string_view text);
/// Without spaces and tabs at either end.
[[nodiscard]] std::string_view trimmed(std::string_view text);
/// `Text/HTML; charset=utf-8` -> `text/html`.
[[nodiscard]] std::string media_type(std::string_view header);
/// `form-data; name="scan"`, `name` -> `scan`; empty when absent. Knows plain and quoted values, no
/// escapes.
[[nodiscard]] std::string parameter_of(std::string_view header, std::string_view name);

/// Weight `q` of an item of an Accept header in [0, 1]: 1 when absent, 0 when it is no number.
[[nodiscard]] double weight_of(std::string_view item);

/// Whether a client takes gzip. @param accept_encoding  value of its header.
[[nodiscard]] bool takes_gzip(std::string_view accept_encoding);

}  // namespace stillmap::server

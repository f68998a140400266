#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::server {

/// A number as the store gives them to drives and jobs; nothing for any other text.
[[nodiscard]] std::optional<std::int64_t> id_in(std::string_view text);
/// A time as "2026-11-29T10:30:00Z" (RFC 3339 in UTC, a fraction of a second is allowed) or as
/// nanoseconds since 1970; nothing for any other text.
[[nodiscard]] std::optional<std::int64_t> time_in(std::string_view text);
/// Since 1970, UTC.
[[nodiscard]] std::int64_t unix_ns();
/// So many lower-case hex digits that nobody can guess.
[[nodiscard]] std::string random_hex(std::size_t digits);

}  // namespace stillmap::server

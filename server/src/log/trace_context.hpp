#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::server {

/// A span of a distributed trace, as `traceparent` carries it.
/// @see W3C Trace Context, Recommendation of 23 November 2021, section 3.2.
struct Span {
  /// 32 lower-case hex digits, not all zero.
  std::string trace_id;
  /// 16 lower-case hex digits, not all zero.
  std::string span_id;
  /// Bit 0: the caller records this trace. Other bits are not passed on (section 3.2.2.5).
  std::uint8_t flags = 0;
};

/// The caller's span. Nothing for a header that breaks a rule: the trace then counts as not sent
/// (section 4.3). White space around it is the HTTP reader's to take off.
[[nodiscard]] std::optional<Span> parse_traceparent(std::string_view header);

/// A span of ours below the caller's: same trace, an id of its own. Safe from any thread.
[[nodiscard]] Span child_of(const Span& parent);

/// What to send to whatever works for this span.
[[nodiscard]] std::string traceparent_of(const Span& span);

}  // namespace stillmap::server

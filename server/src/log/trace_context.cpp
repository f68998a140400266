#include "trace_context.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <random>

namespace stillmap::server {
namespace {

constexpr std::size_t kTraceDigits = 32;
constexpr std::size_t kSpanDigits = 16;
constexpr std::size_t kLength = 55;
constexpr std::uint8_t kSampled = 0x01;

/// Upper case is an error here, unlike elsewhere in HTTP.
int hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  return -1;
}

bool is_hex(std::string_view text) {
  return std::ranges::all_of(text, [](char c) { return hex_digit(c) >= 0; });
}

bool is_id(std::string_view text) {
  return is_hex(text) && text.find_first_not_of('0') != std::string_view::npos;
}

}  // namespace

std::optional<Span> parse_traceparent(std::string_view header) {
  if (header.size() < kLength || header[2] != '-' || header[35] != '-' || header[52] != '-')
    return {};
  const std::string_view version = header.substr(0, 2);
  // A version to come may add fields after another dash; ours has none.
  const bool whole = header.size() == kLength || (version != "00" && header[kLength] == '-');
  if (!whole || !is_hex(version) || version == "ff") return {};
  const std::string_view trace_id = header.substr(3, kTraceDigits);
  const std::string_view span_id = header.substr(36, kSpanDigits);
  const std::string_view flags = header.substr(53, 2);
  if (!is_id(trace_id) || !is_id(span_id) || !is_hex(flags)) return {};
  const int bits = hex_digit(flags[0]) * 16 + hex_digit(flags[1]);
  return Span{.trace_id = std::string(trace_id),
              .span_id = std::string(span_id),
              .flags = static_cast<std::uint8_t>(bits & kSampled)};
}

Span child_of(const Span& parent) {
  static thread_local std::mt19937_64 random = [] {
    std::random_device device;
    return std::mt19937_64((std::uint64_t{device()} << 32U) | device());
  }();
  std::uint64_t id = 0;
  while (id == 0) id = random();
  return {
      .trace_id = parent.trace_id, .span_id = fmt::format("{:016x}", id), .flags = parent.flags};
}

std::string traceparent_of(const Span& span) {
  return fmt::format("00-{}-{}-{:02x}", span.trace_id, span.span_id, span.flags);
}

}  // namespace stillmap::server

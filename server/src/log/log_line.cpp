#include "log_line.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <cmath>

namespace stillmap::server {
namespace {

constexpr std::size_t kMostMessageBytes = 16384;

/// RFC 3339, UTC, to the millisecond.
std::string timestamp(std::chrono::system_clock::time_point time) {
  const auto whole = std::chrono::floor<std::chrono::seconds>(time);
  const auto rest = std::chrono::floor<std::chrono::milliseconds>(time - whole);
  return fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03d}Z",
                     fmt::gmtime(std::chrono::system_clock::to_time_t(whole)), rest.count());
}

std::string json_text(std::string_view text) {
  return nlohmann::json(text).dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
}

std::string plain_text(std::string_view text) {
  std::string result;
  result.reserve(text.size());
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '\\') {
      result += "\\\\";
    } else if (byte < 0x20 || byte > 0x7e) {
      fmt::format_to(std::back_inserter(result), "\\x{:02x}", byte);
    } else {
      result += c;
    }
  }
  return result;
}

/// A value among others on a line: in quotes when it could be taken for more than one.
std::string plain_value(std::string_view text) {
  const bool bare = !text.empty() && text.find_first_of(" \"=") == std::string_view::npos;
  return bare ? plain_text(text) : json_text(text);
}

/// Calls `add(name, text, is_number)` for all that is known, in a fixed order.
template <typename Add>
void for_each_field(const LogEntry& entry, const Add& add) {
  const auto add_text = [&](std::string_view name, std::string_view text) {
    if (!text.empty()) add(name, text, false);
  };
  if (entry.context != nullptr) {
    add_text("request_id", entry.context->request_id);
    add_text("server_request_id", entry.context->server_request_id);
    add_text("trace_id", entry.context->trace_id);
    add_text("span_id", entry.context->span_id);
    add_text("source", entry.context->source);
    add_text("key_id", entry.context->key_id);
  }
  if (entry.access == nullptr) return;
  add_text("method", entry.access->method);
  add_text("route", entry.access->route);
  add("status", fmt::format("{}", entry.access->status), true);
  add("bytes_in", fmt::format("{}", entry.access->bytes_in), true);
  add("bytes_out", fmt::format("{}", entry.access->bytes_out), true);
  // JSON has no NaN.
  const double ms = entry.access->milliseconds;
  add("ms", std::isfinite(ms) ? fmt::format("{:.3f}", ms) : std::string("null"), true);
}

}  // namespace

std::string json_line(const LogEntry& entry) {
  std::string line =
      fmt::format(R"({{"time":"{}","level":{},"message":{})", timestamp(entry.time),
                  json_text(entry.level), json_text(entry.message.substr(0, kMostMessageBytes)));
  for_each_field(entry, [&line](std::string_view name, std::string_view value, bool number) {
    fmt::format_to(std::back_inserter(line), R"(,"{}":{})", name,
                   number ? std::string(value) : json_text(value));
  });
  return line + "}\n";
}

std::string text_line(const LogEntry& entry) {
  std::string line = fmt::format("{} {:7} {}", timestamp(entry.time), entry.level,
                                 plain_text(entry.message.substr(0, kMostMessageBytes)));
  for_each_field(entry, [&line](std::string_view name, std::string_view value, bool) {
    fmt::format_to(std::back_inserter(line), " {}={}", name, plain_value(value));
  });
  return line + "\n";
}

}  // namespace stillmap::server

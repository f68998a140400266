#pragma once

#include "access_log.hpp"
#include "log_context.hpp"

#include <chrono>
#include <string>
#include <string_view>

namespace stillmap::server {

/// One thing to log, with what its thread was doing.
struct LogEntry {
  std::chrono::system_clock::time_point time;
  std::string_view level;
  std::string_view message;
  /// May be nullptr.
  const LogContext* context = nullptr;
  const AccessRecord* access = nullptr;
};

/// Both end in a line feed and hold no other, whatever a client sent: all but printable ASCII is
/// escaped. A message beyond 16 KiB is cut.
/// @return one JSON object.
[[nodiscard]] std::string json_line(const LogEntry& entry);
/// @return `TIME LEVEL message request_id=... status=...`.
[[nodiscard]] std::string text_line(const LogEntry& entry);

}  // namespace stillmap::server

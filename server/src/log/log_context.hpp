#pragma once

#include <string>

namespace stillmap::server {

/// Whose work a thread is doing. Every line that it logs meanwhile carries these; empty ones are
/// left out.
struct LogContext {
  std::string request_id;
  /// Where the client gave `request_id`, which may come twice: the server's own.
  std::string server_request_id{};
  std::string trace_id;
  std::string span_id;
  /// Address of the client.
  std::string source{};
  /// Public id of the API key, never the key.
  std::string key_id;
};

/// Sets the context of this thread for its own life. They nest.
class LogScope {
 public:
  explicit LogScope(LogContext context);
  ~LogScope();
  LogScope(const LogScope&) = delete;
  LogScope& operator=(const LogScope&) = delete;

  /// What becomes known on the way, such as the key.
  [[nodiscard]] LogContext& context() { return context_; }

 private:
  LogContext context_;
  const LogContext* before_;
};

/// Of this thread; nullptr outside every scope.
[[nodiscard]] const LogContext* current_log_context();

}  // namespace stillmap::server

#include "log_output.hpp"

#include "log_line.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <spdlog/sinks/sink.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <stillmap/maps/error.hpp>

#include <cerrno>
#include <cstddef>
#include <cstring>
#include <mutex>
#include <stdexcept>
#include <string>

namespace stillmap::server {
namespace {

spdlog::level::level_enum level_of(const std::string& name) {
  if (name == "debug") return spdlog::level::debug;
  if (name == "info") return spdlog::level::info;
  if (name == "warning") return spdlog::level::warn;
  if (name == "error") return spdlog::level::err;
  throw std::invalid_argument(
      fmt::format("log.level: {}, one of debug, info, warning, error", name));
}

std::string_view name_of(spdlog::level::level_enum level) {
  switch (level) {
    case spdlog::level::trace:
    case spdlog::level::debug:
      return "debug";
    case spdlog::level::info:
      return "info";
    case spdlog::level::warn:
      return "warning";
    default:
      return "error";
  }
}

bool is_json(const std::string& format) {
  if (format == "json") return true;
  if (format == "text") return false;
  throw std::invalid_argument(fmt::format("log.format: {}, one of text, json", format));
}

}  // namespace

/// stderr, or a file that is ours to close.
class LogDestination {
 public:
  LogDestination() = default;
  explicit LogDestination(const std::string& file) {
    if (file.empty()) return;
    // Two processes that append, as during a rotation, do not overwrite each other.
    constexpr int kMode = 0640;
    handle_ = ::open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC | O_NOCTTY, kMode);
    if (handle_ < 0) throw maps::StorageError(file, std::strerror(errno));
  }
  LogDestination(LogDestination&& other) noexcept { swap(other); }
  LogDestination& operator=(LogDestination&& other) noexcept {
    swap(other);
    return *this;
  }
  ~LogDestination() {
    if (handle_ != STDERR_FILENO && handle_ >= 0) ::close(handle_);
  }

  /// @return whether all of it was written.
  [[nodiscard]] bool write(const std::string& text) {
    // After a line that was written in part, so that the next one is whole.
    const std::string mended = torn_ ? "\n" + text : std::string();
    std::string_view line = torn_ ? mended : text;
    while (!line.empty()) {
      const ssize_t written = ::write(handle_, line.data(), line.size());
      if (written < 0 && errno == EINTR) continue;
      if (written <= 0) return false;
      line.remove_prefix(static_cast<std::size_t>(written));
      torn_ = !line.empty();
    }
    return true;
  }

 private:
  void swap(LogDestination& other) {
    std::swap(handle_, other.handle_);
    std::swap(torn_, other.torn_);
  }

  int handle_ = STDERR_FILENO;
  bool torn_ = false;
};

class LogOutput::Sink final : public spdlog::sinks::sink {
 public:
  explicit Sink(const LogOptions& options) { prepare(options)(); }

  std::function<void()> prepare(const LogOptions& options) {
    return [this, json = is_json(options.format), level = level_of(options.level),
            // Shared, since a std::function can be copied.
            destination = std::make_shared<LogDestination>(options.file),
            requests = options.requests] {
      const std::lock_guard lock(mutex_);
      json_ = json;
      destination_ = std::move(*destination);
      // The logger's own level, which is what spdlog asks before it formats.
      spdlog::set_level(level);
      set_request_lines(requests);
    };
  }

  void log(const spdlog::details::log_msg& message) override {
    const LogEntry entry{.time = message.time,
                         .level = name_of(message.level),
                         .message = {message.payload.data(), message.payload.size()},
                         .context = current_log_context(),
                         .access = current_access_record()};
    const std::lock_guard lock(mutex_);
    if (lost_ > 0) report_lost(entry);
    // A full disk must not end the server. What is lost is counted and said once there is room.
    if (!destination_.write(line_of(entry))) ++lost_;
  }
  void flush() override {}
  void set_pattern(const std::string&) override {}
  void set_formatter(std::unique_ptr<spdlog::formatter>) override {}

 private:
  [[nodiscard]] std::string line_of(const LogEntry& entry) const {
    return json_ ? json_line(entry) : text_line(entry);
  }

  void report_lost(const LogEntry& next) {
    const std::string text = fmt::format("{} lines of this log could not be written", lost_);
    if (destination_.write(line_of({.time = next.time, .level = "warning", .message = text})))
      lost_ = 0;
  }

  std::mutex mutex_;
  bool json_ = false;
  LogDestination destination_;
  std::size_t lost_ = 0;
};

LogOutput::LogOutput(const LogOptions& options) : sink_(std::make_shared<Sink>(options)) {
  auto logger = std::make_shared<spdlog::logger>("stillmap", sink_);
  logger->set_level(spdlog::get_level());
  spdlog::set_default_logger(std::move(logger));
}
LogOutput::~LogOutput() = default;

std::function<void()> LogOutput::prepare(const LogOptions& options) {
  return sink_->prepare(options);
}

}  // namespace stillmap::server

#pragma once

#include <stillmap/server/server_options.hpp>

#include <functional>
#include <memory>

namespace stillmap::server {

/// Where all that the process logs through spdlog goes. One for a process.
class LogOutput {
 public:
  /// Becomes spdlog's default logger; lasts until the process ends.
  /// @throws std::invalid_argument on an unknown level or format, maps::StorageError when the file
  /// cannot be opened.
  explicit LogOutput(const LogOptions& options);
  ~LogOutput();
  LogOutput(const LogOutput&) = delete;
  LogOutput& operator=(const LogOutput&) = delete;

  /// Takes other options, and opens the file again even when they are the same, for log rotation.
  /// Safe while others log. @throws as the constructor, with all as it was.
  void reopen(const LogOptions& options) { prepare(options)(); }
  /// The first half of it: opens the file, and changes nothing yet.
  /// @return the rest, which cannot fail. @throws as the constructor.
  [[nodiscard]] std::function<void()> prepare(const LogOptions& options);

 private:
  class Sink;
  std::shared_ptr<Sink> sink_;
};

}  // namespace stillmap::server

#pragma once

#include <stillmap/server/server_options.hpp>

#include <memory>
#include <mutex>

namespace stillmap::server {

/// The options in force. A request takes them once and keeps what it took until its end, so that a
/// reload never changes them under its hands. Safe from any thread.
class OptionsHolder {
 public:
  /// @throws std::invalid_argument when an option is broken.
  explicit OptionsHolder(const ServerOptions& options);

  /// Never nullptr.
  [[nodiscard]] std::shared_ptr<const ServerOptions> current() const;
  /// From the next `current` on. @throws std::invalid_argument when an option is broken, with those
  /// before still in force.
  void replace(const ServerOptions& options);

 private:
  // Not std::atomic<std::shared_ptr>: GCC 12's holds a lock too, and one that TSan cannot see.
  mutable std::mutex mutex_;
  std::shared_ptr<const ServerOptions> options_;
};

}  // namespace stillmap::server

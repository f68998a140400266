#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

namespace stillmap::server {

/// Tells a service manager how the server is, by the datagrams of sd_notify(3). Does nothing where
/// none listens. Safe from any thread.
class Notifier {
 public:
  /// @param socket  what `NOTIFY_SOCKET` says: the path of a socket, or `@` and the name of an
  /// abstract one; empty = nobody listens.
  /// @throws std::invalid_argument for a name that is neither, or too long for an address.
  explicit Notifier(std::string socket);

  /// From `NOTIFY_SOCKET`.
  [[nodiscard]] static Notifier of_process();

  [[nodiscard]] bool listens() const { return !socket_.empty(); }

  /// Each tells whether it was taken; what was not is not tried again.
  bool ready(std::string_view status) const;
  /// With the monotonic time, from which systemd knows that the READY=1 after it is a new one.
  bool reloading() const;
  bool stopping(std::string_view status) const;
  bool alive() const;
  bool status(std::string_view text) const;

 private:
  bool send(const std::string& text) const;

  std::string socket_;
};

/// How often a service manager wants to hear from this process: from `WATCHDOG_USEC`, when
/// `WATCHDOG_PID` is this process or absent.
[[nodiscard]] std::optional<std::chrono::microseconds> watchdog_interval();

/// Says `alive` at half of an interval, each time that `healthy` returns true. A server that no
/// longer answers itself falls silent, and the service manager starts it again.
class Watchdog {
 public:
  /// @param healthy  called on a thread of its own; must return within the interval and throw
  /// nothing.
  Watchdog(const Notifier& notifier, std::chrono::microseconds interval,
           std::function<bool()> healthy);
  ~Watchdog();
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

 private:
  void run();

  const Notifier& notifier_;
  std::chrono::microseconds pause_;
  std::function<bool()> healthy_;
  std::mutex mutex_;
  std::condition_variable ended_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace stillmap::server

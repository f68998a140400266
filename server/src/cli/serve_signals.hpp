#pragma once

#include <chrono>
#include <csignal>
#include <functional>
#include <thread>

namespace stillmap::cli {

/// What signals mean to a server.
struct SignalActions {
  /// SIGHUP, until the first SIGTERM or SIGINT.
  std::function<void()> reload;
  /// First SIGTERM or SIGINT: say that no more should come. @return how long to wait before `stop`.
  std::function<std::chrono::seconds()> drain;
  /// Refuse new connections. @return how long those in hand may take.
  std::function<std::chrono::seconds()> stop;
};

/// Waits for signals on a thread of its own: what a server needs may not be called from a handler.
/// A second SIGTERM or SIGINT ends the process at once, with exit code 130; requests that take
/// longer than they may end it with 0.
class SignalLoop {
 public:
  /// Call before any other thread starts, so that all of them leave these signals to this one.
  SignalLoop();
  /// Ends the thread: what ran has come to its end.
  ~SignalLoop();
  SignalLoop(const SignalLoop&) = delete;
  SignalLoop& operator=(const SignalLoop&) = delete;

  /// Call once.
  void start(SignalActions actions);

 private:
  void run();
  /// @return whether the time passed without an end.
  bool wait(std::chrono::seconds time);

  sigset_t signals_{};
  SignalActions actions_;
  std::thread thread_;
};

}  // namespace stillmap::cli

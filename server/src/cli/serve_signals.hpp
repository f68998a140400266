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
  /// First SIGTERM or SIGINT: begin to end. @return how long that may take.
  std::function<std::chrono::seconds()> drain;
};

/// Waits for signals on its own thread, because a signal handler may not call what a server needs.
/// A second SIGTERM or SIGINT ends the process at once, with exit code 130; so does taking longer
/// than told, with 0: what must last is on the disk at any time.
class SignalLoop {
 public:
  /// Call before any other thread starts, so that all of them leave these signals to this one.
  static void block();

  /// The actions' own things must outlive this.
  explicit SignalLoop(SignalActions actions);
  /// Ends the thread: what ran has come to its end.
  ~SignalLoop();
  SignalLoop(const SignalLoop&) = delete;
  SignalLoop& operator=(const SignalLoop&) = delete;

 private:
  void run();
  /// @return whether the time passed without an end.
  bool wait(std::chrono::seconds time);

  SignalActions actions_;
  std::thread thread_;
};

}  // namespace stillmap::cli

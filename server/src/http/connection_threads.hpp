#pragma once

#include <pthread.h>

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <vector>

namespace stillmap::server {

/// A thread for each connection, made at need: an idle server has none, a full one `most`. A thread
/// that had nothing to do for some seconds ends.
class ConnectionThreads {
 public:
  /// Of each thread [bytes]. No recursion of ours or of the HTTP library's depends on what a client
  /// sends; the localizer's own work needs some 100 KiB. Only touched pages count as memory.
  static constexpr std::size_t kStackBytes = std::size_t{1} << 20U;

  /// @param serve  is given each socket on a thread; must not throw.  @param most  >= 1.
  ConnectionThreads(std::size_t most, std::function<void(int)> serve)
      : most_(most), serve_(std::move(serve)) {}
  /// Waits for all.
  ~ConnectionThreads();
  ConnectionThreads(const ConnectionThreads&) = delete;
  ConnectionThreads& operator=(const ConnectionThreads&) = delete;

  /// @return false when all threads are taken, or none can be made.
  [[nodiscard]] bool offer(int socket);
  /// Connections that are served.
  [[nodiscard]] std::size_t busy() const;
  /// Waits until every connection is served and no thread is left; nothing may be offered then.
  void finish();

 private:
  static void* enter(void* self);
  void work();
  [[nodiscard]] bool start_thread();
  void join_ended();

  const std::size_t most_;
  const std::function<void(int)> serve_;
  mutable std::mutex mutex_;
  std::condition_variable offered_;
  std::condition_variable ended_changed_;
  std::deque<int> sockets_;
  std::size_t threads_ = 0;
  std::size_t idle_ = 0;
  bool finishing_ = false;
  /// Threads that are done and can be joined at once.
  std::vector<pthread_t> ended_;
};

}  // namespace stillmap::server

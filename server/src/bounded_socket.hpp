#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>

namespace stillmap::server {

/// How much and how long one connection may take.
struct ConnectionLimits {
  std::chrono::seconds keep_alive{2};
  /// Without a single byte moving.
  std::chrono::seconds stall{5};
  /// For receiving one request, and for sending one answer.
  std::chrono::seconds transfer{60};
  std::size_t max_head_bytes = std::size_t{32} << 10U;
  /// The HTTP library runs recursive regular expressions over request line and Range header: the
  /// bound keeps them within a thread's stack.
  std::size_t max_line_bytes = std::size_t{4} << 10U;
};

/// A connected socket that reads and writes within limits. One thread at a time.
class BoundedSocket {
 public:
  /// @param socket  stays the caller's.
  BoundedSocket(int socket, const ConnectionLimits& limits) : socket_(socket), limits_(limits) {}

  /// Waits for the first byte of a request. @return false when none came in time, or once
  /// `stopping` is set.
  [[nodiscard]] bool wait_for_request(const std::atomic<bool>& stopping);
  /// The next bytes are the head of a request; starts its clock.
  void begin_request();
  /// @return bytes read, 0 at the end, -1 on error or beyond a limit.
  [[nodiscard]] long read(char* to, std::size_t size);
  /// Writes all. @return bytes written, or -1 on error or beyond a limit.
  [[nodiscard]] long write(const char* from, std::size_t size);
  [[nodiscard]] bool can_write() const;
  /// Says that no more is written and takes what is still under way, so that the peer reads the
  /// last answer instead of a reset. Short: a bounded number of bytes and one second.
  void linger();

  [[nodiscard]] bool head_too_large() const { return head_too_large_; }
  [[nodiscard]] int socket() const { return socket_; }

 private:
  using Clock = std::chrono::steady_clock;

  [[nodiscard]] bool wait(short events, Clock::time_point until) const;
  [[nodiscard]] bool fill();
  [[nodiscard]] long receive(char* to, std::size_t size);
  [[nodiscard]] bool count_head(char c);

  int socket_;
  ConnectionLimits limits_;
  std::array<char, 16384> buffer_{};
  std::size_t begin_ = 0;
  std::size_t end_ = 0;
  bool in_head_ = false;
  bool head_too_large_ = false;
  bool sending_ = false;
  std::size_t head_bytes_ = 0;
  std::size_t line_bytes_ = 0;
  char last_ = 0;
  Clock::time_point receive_until_;
  Clock::time_point send_until_;
};

}  // namespace stillmap::server

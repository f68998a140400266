#pragma once

#include "http/tls.hpp"

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>

namespace stillmap::server {

/// How much and how long one connection may take.
struct ConnectionLimits {
  std::chrono::milliseconds keep_alive{2'000};
  /// For the head of a request, and for the TLS handshake.
  std::chrono::milliseconds head{10'000};
  /// Without a single byte moving.
  std::chrono::milliseconds stall{5'000};
  /// For receiving one request, and for sending one answer; longer for what moves faster than
  /// `kLeastBytesPerSecond`, since an upload of gigabytes is no slow client.
  std::chrono::milliseconds transfer{60'000};
  /// Without a word of the peer's machine about what was sent to it, at least `stall`: a vehicle
  /// out of radio range says no goodbye, and what is sent to it still fits into the kernel's
  /// buffer.
  std::chrono::milliseconds unacknowledged{30'000};
  std::size_t max_head_bytes = std::size_t{32} << 10U;
  std::size_t max_line_bytes = std::size_t{4} << 10U;
};

/// A connected socket, plain or TLS, that reads and writes within limits. One thread at a time.
class BoundedSocket {
 public:
  /// A client that stays below it runs into `ConnectionLimits::transfer` [bytes/s].
  static constexpr std::int64_t kLeastBytesPerSecond = 128 << 10;

  /// Whoever looks after all connections.
  struct Watcher {
    /// Called with true when the peer takes no more of what is written, again when it took some
    /// meanwhile, and with false when it takes all again.
    std::function<void(bool)> stalls;
    /// Whether the connection is to end at once.
    std::function<bool()> is_cut;
  };

  /// @param socket  non-blocking; stays the caller's.  @param tls  none = plain.
  /// @param watcher  may leave its functions empty.
  BoundedSocket(int socket, const ConnectionLimits& limits, std::unique_ptr<TlsSession> tls = {},
                Watcher watcher = {})
      : socket_(socket), limits_(limits), tls_(std::move(tls)), watcher_(std::move(watcher)) {}

  /// Of TLS; nothing to do without. @return false when it fails or takes too long.
  [[nodiscard]] bool handshake();
  /// Waits for the first byte of a request. @return false when none came in time, or the peer (or
  /// `shutdown` from another thread) has ended the connection.
  [[nodiscard]] bool wait_for_request();

  enum class HeadState : std::uint8_t { kComplete, kTooLarge, kEnded };
  /// Reads the head of a request and starts its clock. @param head  up to and including the empty
  /// line that ends it.
  [[nodiscard]] HeadState read_head(std::string& head);
  /// Of the body. @return bytes read, 0 or less at the end, on error or beyond a limit.
  [[nodiscard]] long read(char* to, std::size_t size);
  /// Writes all. @return bytes written, or -1 on error or beyond a limit.
  [[nodiscard]] long write(const char* from, std::size_t size);
  /// The next piece of an answer that goes on as long as both want has the time of a whole one.
  void restart_send() { sending_ = false; }
  [[nodiscard]] bool can_write() const;
  /// Ends the sending and waits until the peer has taken the last answer. Meanwhile it reads and
  /// drops what the peer still sends, for a second and a bounded number of bytes: closing with
  /// unread bytes would reset the connection before the peer has read the answer. A peer that does
  /// not take the answer within the limits is reset, since the kernel would keep the answer for
  /// long.
  void finish();
  /// The same between two requests: returns at once when the peer has taken all answers.
  void finish_idle();

  /// Whether the peer has closed the connection, or its sending side.
  [[nodiscard]] bool peer_left() const;

  [[nodiscard]] bool is_tls() const { return tls_ != nullptr; }

 private:
  using Clock = std::chrono::steady_clock;

  [[nodiscard]] bool wait(short events, Clock::time_point until) const;
  [[nodiscard]] Moved receive_some(char* to, std::size_t size);
  [[nodiscard]] Moved send_some(const char* from, std::size_t size);
  [[nodiscard]] bool fill(Clock::time_point until);
  [[nodiscard]] long receive(char* to, std::size_t size, Clock::time_point until);
  [[nodiscard]] HeadState take_head(std::string& head);
  [[nodiscard]] bool wait_for_taker(short events) const;
  void tell_stalled(bool stalled) const;
  [[nodiscard]] int untaken_bytes() const;
  void reset_at_close() const;

  int socket_;
  ConnectionLimits limits_;
  std::unique_ptr<TlsSession> tls_;
  Watcher watcher_;
  // Not set to zero: an idle connection then does not touch it.
  std::array<char, 16384> buffer_;
  std::size_t begin_ = 0;
  std::size_t end_ = 0;
  /// Of the line of the head that is being read.
  std::size_t line_bytes_ = 0;
  bool sending_ = false;
  /// An answer broke off.
  bool failed_ = false;
  Clock::time_point receive_until_;
  Clock::time_point send_until_;
};

}  // namespace stillmap::server

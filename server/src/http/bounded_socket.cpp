#include "http/bounded_socket.hpp"

#include <linux/sockios.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <thread>

namespace stillmap::server {
namespace {

Moved moved_by(ssize_t returned, short direction) {
  if (returned >= 0) return {.bytes = returned};
  const bool again = errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
  return {.bytes = -1, .wait_for = again ? direction : short{0}};
}

/// What so many bytes add to the time that a transfer may take.
std::chrono::nanoseconds earned(std::size_t bytes) {
  return std::chrono::nanoseconds(static_cast<std::int64_t>(bytes) * 1'000'000'000 /
                                  BoundedSocket::kLeastBytesPerSecond);
}

}  // namespace

bool BoundedSocket::wait(short events, Clock::time_point until) const {
  for (;;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - Clock::now());
    pollfd entry{.fd = socket_, .events = events, .revents = 0};
    const int ready = ::poll(&entry, 1, static_cast<int>(std::max<std::int64_t>(0, left.count())));
    if (ready > 0) return true;
    if (ready == 0 || errno != EINTR) return false;
  }
}

Moved BoundedSocket::receive_some(char* to, std::size_t size) {
  if (tls_) return tls_->receive(to, size);
  return moved_by(::recv(socket_, to, size, MSG_DONTWAIT), POLLIN);
}

Moved BoundedSocket::send_some(const char* from, std::size_t size) {
  if (tls_) return tls_->send(from, size);
  return moved_by(::send(socket_, from, size, MSG_NOSIGNAL | MSG_DONTWAIT), POLLOUT);
}

bool BoundedSocket::handshake() {
  if (!tls_) return true;
  const Clock::time_point until = Clock::now() + limits_.head;
  for (;;) {
    const Moved moved = tls_->handshake();
    if (moved.bytes > 0) return true;
    if (moved.wait_for == 0 ||
        !wait(moved.wait_for, std::min(until, Clock::now() + limits_.stall))) {
      return false;
    }
  }
}

bool BoundedSocket::wait_for_request() {
  return begin_ < end_ || fill(Clock::now() + limits_.keep_alive);
}

bool BoundedSocket::fill(Clock::time_point until) {
  const long got = receive(buffer_.data(), buffer_.size(), until);
  begin_ = 0;
  end_ = got > 0 ? static_cast<std::size_t>(got) : 0;
  return got > 0;
}

/// @return bytes, or -1 at the end, on an error and when none came in time.
long BoundedSocket::receive(char* to, std::size_t size, Clock::time_point until) {
  for (;;) {
    const Moved moved = receive_some(to, size);
    if (moved.bytes > 0) return moved.bytes;
    if (moved.wait_for == 0 || !wait(moved.wait_for, until)) return -1;
  }
}

BoundedSocket::HeadState BoundedSocket::read_head(std::string& head) {
  head.clear();
  line_bytes_ = 0;
  sending_ = false;
  const Clock::time_point now = Clock::now();
  const Clock::time_point head_until = now + limits_.head;
  receive_until_ = now + limits_.transfer;
  for (;;) {
    if (begin_ == end_ && !fill(std::min(head_until, Clock::now() + limits_.stall))) {
      return HeadState::kEnded;
    }
    const HeadState state = take_head(head);
    if (state != HeadState::kEnded) return state;
  }
}

BoundedSocket::HeadState BoundedSocket::take_head(std::string& head) {
  while (begin_ < end_) {
    const char c = buffer_[begin_++];
    head.push_back(c);
    line_bytes_ = c == '\n' ? line_bytes_ : line_bytes_ + 1;
    if (head.size() > limits_.max_head_bytes || line_bytes_ > limits_.max_line_bytes) {
      return HeadState::kTooLarge;
    }
    if (c != '\n') continue;
    // A bare line feed ends the head too: whoever sends one is refused, and waits for the answer.
    const bool empty = line_bytes_ == 0 || (line_bytes_ == 1 && head.ends_with("\r\n"));
    line_bytes_ = 0;
    // An empty line before a request is left over from the one before, RFC 9112, 2.2.
    if (empty && head.size() <= 2) head.clear();
    if (empty && !head.empty()) return HeadState::kComplete;
  }
  return HeadState::kEnded;
}

long BoundedSocket::read(char* to, std::size_t size) {
  const Clock::time_point until = std::min(receive_until_, Clock::now() + limits_.stall);
  // A scan of two megabytes goes straight to where it will lie.
  if (begin_ == end_ && size >= buffer_.size()) {
    const long got = receive(to, size, until);
    if (got > 0) receive_until_ += earned(static_cast<std::size_t>(got));
    return got;
  }
  if (begin_ == end_ && !fill(until)) return -1;
  const std::size_t count = std::min(size, end_ - begin_);
  std::memcpy(to, buffer_.data() + begin_, count);
  begin_ += count;
  receive_until_ += earned(count);
  return static_cast<long>(count);
}

long BoundedSocket::write(const char* from, std::size_t size) {
  if (!sending_) {
    sending_ = true;
    send_until_ = Clock::now() + limits_.transfer;
  }
  failed_ = true;  // until all is written
  std::size_t sent = 0;
  while (sent < size) {
    const Moved moved = send_some(from + sent, size - sent);
    if (moved.bytes > 0) {
      sent += static_cast<std::size_t>(moved.bytes);
      send_until_ += earned(static_cast<std::size_t>(moved.bytes));
    } else if (moved.wait_for == 0 || !wait_for_taker(moved.wait_for)) {
      return -1;
    }
  }
  failed_ = false;
  return static_cast<long>(sent);
}

/// Whoever takes a little of it again and again is slow, and has not stalled: the kernel says that
/// there is room only when there is much of it.
bool BoundedSocket::wait_for_taker(short events) const {
  constexpr std::chrono::milliseconds kLookEvery(250);
  tell_stalled(true);
  int untaken = untaken_bytes();
  Clock::time_point stall_until = Clock::now() + limits_.stall;
  bool taken = false;
  for (;;) {
    const Clock::time_point until = std::min(send_until_, stall_until);
    taken = wait(events, std::min(until, Clock::now() + kLookEvery));
    if (taken || Clock::now() >= until) break;
    const int left = untaken_bytes();
    if (left < untaken) {
      stall_until = Clock::now() + limits_.stall;
      tell_stalled(true);
    }
    untaken = left;
  }
  tell_stalled(false);
  return taken;
}

void BoundedSocket::tell_stalled(bool stalled) const {
  if (watcher_.stalls) watcher_.stalls(stalled);
}

bool BoundedSocket::can_write() const { return wait(POLLOUT, Clock::now() + limits_.stall); }

bool BoundedSocket::peer_left() const {
  // Not by POLLRDHUP, which also says that another thread of ours has ended the reading.
  tcp_info info{};
  socklen_t size = sizeof(info);
  if (::getsockopt(socket_, IPPROTO_TCP, TCP_INFO, &info, &size) != 0) return false;
  return info.tcpi_state != TCP_ESTABLISHED;
}

/// What the peer's machine has not acknowledged, the end of the connection (1) included.
int BoundedSocket::untaken_bytes() const {
  int bytes = 0;
  return ::ioctl(socket_, SIOCOUTQ, &bytes) == 0 ? bytes : 0;
}

void BoundedSocket::reset_at_close() const {
  const linger at_once{.l_onoff = 1, .l_linger = 0};
  ::setsockopt(socket_, SOL_SOCKET, SO_LINGER, &at_once, sizeof(at_once));
}

void BoundedSocket::finish() {
  constexpr std::size_t kMostBytes = std::size_t{16} << 20U;
  constexpr std::chrono::milliseconds kLookEvery(50);
  constexpr int kEnd = 1;
  if (failed_) return reset_at_close();
  if (tls_) tls_->end();
  ::shutdown(socket_, SHUT_WR);
  const Clock::time_point receive_until = Clock::now() + std::chrono::seconds(1);
  Clock::time_point stall_until = Clock::now() + limits_.stall;
  const Clock::time_point send_until = sending_ ? send_until_ : stall_until;
  int untaken = untaken_bytes();
  if (untaken > kEnd) tell_stalled(true);
  for (std::size_t received = 0; received < kMostBytes;) {
    const Clock::time_point now = Clock::now();
    if (now > receive_until && untaken <= kEnd) return;
    if (wait(POLLIN, now + kLookEvery)) {
      const ssize_t got = ::recv(socket_, buffer_.data(), buffer_.size(), MSG_DONTWAIT);
      if (got < 0 && (errno == EAGAIN || errno == EINTR)) continue;
      // After the peer's own end it may still take what was sent to it.
      if (got < 0 || (got == 0 && untaken_bytes() <= kEnd)) return;
      if (got == 0) std::this_thread::sleep_for(kLookEvery);
      received += static_cast<std::size_t>(got);
    }
    const int left = untaken_bytes();
    if (left > kEnd && left < untaken) {
      stall_until = Clock::now() + limits_.stall;
      tell_stalled(true);
    }
    const bool is_cut = watcher_.is_cut && watcher_.is_cut();
    if (left > kEnd && (is_cut || Clock::now() > std::min(stall_until, send_until)))
      return reset_at_close();
    untaken = left;
  }
  if (untaken > kEnd) reset_at_close();
}

void BoundedSocket::finish_idle() {
  if (failed_ || untaken_bytes() > 0) finish();
}

}  // namespace stillmap::server

#include "bounded_socket.hpp"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace stillmap::server {

bool BoundedSocket::wait(short events, Clock::time_point until) const {
  for (;;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - Clock::now());
    pollfd entry{.fd = socket_, .events = events, .revents = 0};
    const int ready = ::poll(&entry, 1, static_cast<int>(std::max<std::int64_t>(0, left.count())));
    if (ready > 0) return true;
    if (ready == 0 || errno != EINTR) return false;
  }
}

bool BoundedSocket::wait_for_request(const std::atomic<bool>& stopping) {
  const Clock::time_point until = Clock::now() + limits_.keep_alive;
  while (!stopping) {
    if (begin_ < end_ ||
        wait(POLLIN, std::min(until, Clock::now() + std::chrono::milliseconds(50))))
      return true;
    if (Clock::now() >= until) return false;
  }
  return false;
}

void BoundedSocket::begin_request() {
  in_head_ = true;
  head_too_large_ = false;
  sending_ = false;
  head_bytes_ = 0;
  line_bytes_ = 0;
  last_ = 0;
  receive_until_ = Clock::now() + limits_.transfer;
}

long BoundedSocket::receive(char* to, std::size_t size) {
  if (!wait(POLLIN, std::min(receive_until_, Clock::now() + limits_.stall))) return -1;
  return ::recv(socket_, to, size, 0);
}

bool BoundedSocket::fill() {
  const long got = receive(buffer_.data(), buffer_.size());
  begin_ = 0;
  end_ = got > 0 ? static_cast<std::size_t>(got) : 0;
  return got > 0;
}

bool BoundedSocket::count_head(char c) {
  ++head_bytes_;
  if (c == '\n') {
    // "\r\n" alone and nothing else ends the head for the HTTP library too; were this looser than
    // that, what follows would be read as a head without bounds.
    if (line_bytes_ == 1 && last_ == '\r') in_head_ = false;
    line_bytes_ = 0;
  } else {
    ++line_bytes_;
  }
  last_ = c;
  head_too_large_ = head_bytes_ > limits_.max_head_bytes || line_bytes_ > limits_.max_line_bytes;
  return !head_too_large_;
}

long BoundedSocket::read(char* to, std::size_t size) {
  if (head_too_large_) return -1;
  // A scan of two megabytes goes straight to where it will lie.
  if (begin_ == end_ && !in_head_ && size >= buffer_.size()) return receive(to, size);
  if (begin_ == end_ && !fill()) return -1;
  if (in_head_) {
    *to = buffer_[begin_++];
    return count_head(*to) ? 1 : -1;
  }
  const std::size_t count = std::min(size, end_ - begin_);
  std::memcpy(to, buffer_.data() + begin_, count);
  begin_ += count;
  return static_cast<long>(count);
}

long BoundedSocket::write(const char* from, std::size_t size) {
  if (!sending_) {
    sending_ = true;
    send_until_ = Clock::now() + limits_.transfer;
  }
  std::size_t sent = 0;
  while (sent < size) {
    if (!wait(POLLOUT, std::min(send_until_, Clock::now() + limits_.stall))) return -1;
    const ssize_t now = ::send(socket_, from + sent, size - sent, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (now < 0 && errno != EAGAIN && errno != EINTR) return -1;
    sent += now > 0 ? static_cast<std::size_t>(now) : 0;
  }
  return static_cast<long>(sent);
}

bool BoundedSocket::can_write() const { return wait(POLLOUT, Clock::now() + limits_.stall); }

void BoundedSocket::linger() {
  constexpr std::size_t kMostBytes = std::size_t{16} << 20U;
  ::shutdown(socket_, SHUT_WR);
  const Clock::time_point until = Clock::now() + std::chrono::seconds(1);
  for (std::size_t taken = 0; taken < kMostBytes && wait(POLLIN, until);) {
    const ssize_t got = ::recv(socket_, buffer_.data(), buffer_.size(), MSG_DONTWAIT);
    if (got <= 0) return;
    taken += static_cast<std::size_t>(got);
  }
}

}  // namespace stillmap::server

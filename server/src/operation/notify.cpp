#include "operation/notify.hpp"

#include "http/request_id.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <stdexcept>
#include <utility>

namespace stillmap::server {
namespace {

std::string variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? std::string() : std::string(value);
}

std::optional<std::int64_t> whole_number(const std::string& text) {
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return {};
  return value;
}

std::int64_t monotonic_us() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return std::int64_t{now.tv_sec} * 1'000'000 + now.tv_nsec / 1000;
}

/// A line feed would begin another assignment.
std::string status_line(std::string_view text) { return "STATUS=" + printable(text); }

}  // namespace

Notifier::Notifier(std::string socket) : socket_(std::move(socket)) {
  if (socket_.empty()) return;
  const bool named = socket_.size() > 1 && (socket_[0] == '/' || socket_[0] == '@');
  if (!named || socket_.size() >= sizeof(sockaddr_un::sun_path)) {
    throw std::invalid_argument(
        fmt::format("NOTIFY_SOCKET: found '{}', expected the path of a socket, or @ and a name",
                    printable(socket_)));
  }
}

Notifier Notifier::of_process() { return Notifier(variable("NOTIFY_SOCKET")); }

bool Notifier::send(const std::string& text) const {
  if (socket_.empty()) return false;
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, socket_.data(), socket_.size());
  std::size_t size = offsetof(sockaddr_un, sun_path) + socket_.size();
  if (socket_[0] == '@') {
    // Abstract: begins with a zero, and every byte counts, so there is none at the end.
    address.sun_path[0] = '\0';
  } else {
    ++size;
  }
  const int handle = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (handle < 0) return false;
  // Not to wait when nobody takes them: a full queue must not stop the server.
  const ssize_t sent =
      ::sendto(handle, text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT,
               reinterpret_cast<const sockaddr*>(&address), static_cast<socklen_t>(size));
  ::close(handle);
  return sent == static_cast<ssize_t>(text.size());
}

bool Notifier::ready(std::string_view status) const {
  return send("READY=1\n" + status_line(status));
}
bool Notifier::reloading() const {
  return send(fmt::format("RELOADING=1\nMONOTONIC_USEC={}\n{}", monotonic_us(),
                          status_line("reading the configuration again")));
}
bool Notifier::stopping(std::string_view status) const {
  return send("STOPPING=1\n" + status_line(status));
}
bool Notifier::alive() const { return send("WATCHDOG=1"); }
bool Notifier::status(std::string_view text) const { return send(status_line(text)); }

std::optional<std::chrono::microseconds> watchdog_interval() {
  const std::optional<std::int64_t> interval = whole_number(variable("WATCHDOG_USEC"));
  const std::string pid = variable("WATCHDOG_PID");
  if (!interval || *interval <= 0) return {};
  if (!pid.empty() && whole_number(pid) != std::int64_t{::getpid()}) return {};
  return std::chrono::microseconds(*interval);
}

Watchdog::Watchdog(const Notifier& notifier, std::chrono::microseconds interval,
                   std::function<bool()> healthy)
    : notifier_(notifier), pause_(interval / 2), healthy_(std::move(healthy)) {
  thread_ = std::thread([this] { run(); });
}

Watchdog::~Watchdog() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  ended_.notify_all();
  thread_.join();
}

void Watchdog::run() {
  std::unique_lock lock(mutex_);
  auto next = std::chrono::steady_clock::now();
  while (!stopping_) {
    lock.unlock();
    if (healthy_()) notifier_.alive();
    lock.lock();
    // From turn to turn, so that a slow check does not stretch the interval.
    next = std::max(next + pause_, std::chrono::steady_clock::now());
    ended_.wait_until(lock, next, [this] { return stopping_; });
  }
}

}  // namespace stillmap::server

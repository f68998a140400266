#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

namespace stillmap::test {

/// A server on 127.0.0.1 that gives one answer after the other from a list, or those of a function,
/// and keeps what it was asked. When the list is used up it answers 599.
class ScriptedHttpServer {
 public:
  struct Answer {
    int status = 200;
    std::vector<std::string> headers{};
    std::string body{};
    /// Bytes of the body after which the connection is closed.
    std::size_t cut_after = std::string::npos;
    /// Closes the connection without an answer.
    bool drops = false;
    /// For HEAD.
    bool has_body = true;
  };
  struct Asked {
    std::string method, target, body;
    std::map<std::string, std::string> headers{};
    int connection = 0;
  };

  using Handler = std::function<Answer(const Asked& asked)>;

  /// @param handler  is asked, from several threads, when the list is used up.
  explicit ScriptedHttpServer(Handler handler = {})
      : handler_(std::move(handler)), listener_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    auto* const place = reinterpret_cast<sockaddr*>(&address);
    if (::bind(listener_, place, size) != 0 || ::listen(listener_, 64) != 0 ||
        ::getsockname(listener_, place, &size) != 0)
      throw std::runtime_error("cannot listen on 127.0.0.1");
    port_ = ntohs(address.sin_port);
    thread_ = std::jthread([this] { accept_all(); });
  }
  ~ScriptedHttpServer() {
    ended_ = true;
    ::shutdown(listener_, SHUT_RDWR);
    thread_.join();
    {
      const std::scoped_lock lock(mutex_);
      for (const int socket : sockets_) ::shutdown(socket, SHUT_RDWR);
    }
    connections_.clear();
    for (const int socket : sockets_) ::close(socket);
    ::close(listener_);
  }
  ScriptedHttpServer(const ScriptedHttpServer&) = delete;
  ScriptedHttpServer& operator=(const ScriptedHttpServer&) = delete;

  [[nodiscard]] std::string url() const { return "http://127.0.0.1:" + std::to_string(port_); }
  void add(Answer answer) {
    const std::scoped_lock lock(mutex_);
    answers_.push_back(std::move(answer));
  }
  [[nodiscard]] std::vector<Asked> asked() const {
    const std::scoped_lock lock(mutex_);
    return asked_;
  }

 private:
  void accept_all() {
    for (int number = 0; !ended_; ++number) {
      const int socket = ::accept(listener_, nullptr, nullptr);
      if (socket < 0) continue;
      const timeval patience{.tv_sec = 10, .tv_usec = 0};
      ::setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof(patience));
      const std::scoped_lock lock(mutex_);
      sockets_.push_back(socket);
      connections_.emplace_back([this, socket, number] {
        while (serve_one(socket, number)) {
        }
        ::shutdown(socket, SHUT_RDWR);
      });
    }
  }
  static bool send_all(int socket, std::string_view bytes) {
    while (!bytes.empty()) {
      const ssize_t sent = ::send(socket, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (sent <= 0) return false;
      bytes.remove_prefix(static_cast<std::size_t>(sent));
    }
    return true;
  }
  static bool receive(int socket, std::string& text) {
    char buffer[65536];
    const ssize_t got = ::recv(socket, buffer, sizeof(buffer), 0);
    if (got <= 0) return false;
    text.append(buffer, static_cast<std::size_t>(got));
    return true;
  }
  static Asked parse_head(const std::string& head) {
    Asked asked;
    std::size_t at = head.find("\r\n");
    const std::string line = head.substr(0, at);
    asked.method = line.substr(0, line.find(' '));
    asked.target = line.substr(asked.method.size() + 1, line.rfind(' ') - asked.method.size() - 1);
    while (at + 2 < head.size()) {
      const std::size_t end = head.find("\r\n", at + 2);
      const std::string header = head.substr(at + 2, end - at - 2);
      at = end;
      if (header.empty()) break;
      std::string name = header.substr(0, header.find(':'));
      std::ranges::transform(name, name.begin(), [](unsigned char c) { return std::tolower(c); });
      asked.headers[name] = header.substr(std::min(header.size(), name.size() + 2));
    }
    return asked;
  }
  /// @return whether the connection stays.
  bool serve_one(int socket, int number) {
    std::string text;
    while (text.find("\r\n\r\n") == std::string::npos)
      if (!receive(socket, text)) return false;
    const std::size_t head_bytes = text.find("\r\n\r\n") + 4;
    Asked asked = parse_head(text.substr(0, head_bytes));
    asked.connection = number;
    text.erase(0, head_bytes);
    if (asked.headers.contains("expect")) send_all(socket, "HTTP/1.1 100 Continue\r\n\r\n");
    const auto length = asked.headers.find("content-length");
    const std::size_t bytes = length == asked.headers.end() ? 0 : std::stoul(length->second);
    while (text.size() < bytes)
      if (!receive(socket, text)) return false;
    asked.body = text.substr(0, bytes);
    Answer answer{.status = 599};
    {
      const std::scoped_lock lock(mutex_);
      asked_.push_back(asked);
      if (next_ < answers_.size()) answer = answers_[next_++];
    }
    if (answer.status == 599 && handler_) answer = handler_(asked);
    if (answer.drops) return false;
    if (asked.method == "HEAD" && answer.has_body) answer.body.clear();
    std::string head = "HTTP/1.1 " + std::to_string(answer.status) + " Said\r\n";
    for (const std::string& header : answer.headers) head += header + "\r\n";
    if (answer.has_body && answer.status != 204)
      head += "Content-Length: " + std::to_string(answer.body.size()) + "\r\n";
    if (!send_all(socket, head + "\r\n")) return false;
    if (!answer.has_body) return true;
    const bool is_cut = answer.cut_after < answer.body.size();
    return send_all(socket, std::string_view(answer.body).substr(0, answer.cut_after)) && !is_cut;
  }

  Handler handler_;
  mutable std::mutex mutex_;
  std::vector<Answer> answers_;
  std::size_t next_ = 0;
  std::vector<Asked> asked_;
  int listener_;
  int port_ = 0;
  std::atomic<bool> ended_ = false;
  std::vector<int> sockets_;
  std::vector<std::jthread> connections_;
  std::jthread thread_;
};

}  // namespace stillmap::test

#pragma once

#include <chrono>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>

namespace stillmap::bench {

/// One keep-alive connection over a plain socket, so that as little as possible of what is measured
/// is the client. Blocking; one thread at a time.
class Client {
 public:
  /// @param content_type  of all bodies.
  explicit Client(int port, std::string content_type = "application/octet-stream")
      : port_(port), content_type_(std::move(content_type)) {}
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;
  ~Client() { close(); }

  struct Answer {
    /// 0 when the connection broke.
    int status = 0;
    std::string body;
  };
  /// Sends and waits. A refusal that comes while the body is being sent ends the sending, as a
  /// vehicle with little bandwidth would have it. Connects anew when the server has closed.
  Answer request(std::string_view method, std::string_view target, std::string_view body = {});

 private:
  [[nodiscard]] bool connect();
  void close();
  [[nodiscard]] bool send(std::string_view bytes, bool stop_when_answered);
  [[nodiscard]] Answer receive();

  int port_;
  std::string content_type_;
  int socket_ = -1;
  std::string buffer_;
};

}  // namespace stillmap::bench

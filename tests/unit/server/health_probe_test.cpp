#include "operation/health_probe.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <string>
#include <thread>

namespace stillmap::server {
namespace health_probe_test {

/// Listens on loopback; answers nothing by itself.
class Listening {
 public:
  Listening() : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::bind(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    EXPECT_EQ(::listen(socket_, 4), 0);
    socklen_t size = sizeof address;
    ::getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
  }
  ~Listening() { ::close(socket_); }
  Listening(const Listening&) = delete;
  Listening& operator=(const Listening&) = delete;

  [[nodiscard]] int port() const { return port_; }
  void answer_once(const std::string& text) const {
    const int connection = ::accept(socket_, nullptr, nullptr);
    std::array<char, 1024> buffer{};
    EXPECT_GT(::recv(connection, buffer.data(), buffer.size(), 0), 0);
    EXPECT_GE(::send(connection, text.data(), text.size(), MSG_NOSIGNAL), 0);
    ::close(connection);
  }

 private:
  int socket_;
  int port_ = 0;
};

bool probe_answered(const std::string& text) {
  const Listening server;
  std::thread thread([&] { server.answer_once(text); });
  const bool good = answers_livez("0.0.0.0", server.port(), std::chrono::seconds(5));
  thread.join();
  return good;
}

TEST(HealthProbe, Only200IsHealthy) {
  EXPECT_TRUE(probe_answered("HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n"));
  EXPECT_FALSE(probe_answered("HTTP/1.1 503 Busy\r\n\r\n"));
  EXPECT_FALSE(probe_answered("HTTP/1.1 2"));
  EXPECT_FALSE(probe_answered("SSH-2.0-x\r\n"));
}

TEST(HealthProbe, AServerThatHangsOrIsGoneIsNot) {
  int port = 0;
  {
    const Listening silent;
    port = silent.port();
    EXPECT_FALSE(answers_livez("127.0.0.1", port, std::chrono::milliseconds(50)));
  }
  EXPECT_FALSE(answers_livez("127.0.0.1", port, std::chrono::milliseconds(50)));
  EXPECT_FALSE(answers_livez("no.such.host.invalid", port, std::chrono::milliseconds(50)));
}

}  // namespace health_probe_test
}  // namespace stillmap::server

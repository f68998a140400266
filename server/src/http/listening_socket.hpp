#pragma once

#include <chrono>
#include <string>

namespace stillmap::server {

/// A TCP socket that takes connections.
class ListeningSocket {
 public:
  /// @param port  0 takes any free one.
  /// @throws std::runtime_error when the address cannot be had.
  ListeningSocket(const std::string& host, int port);
  ~ListeningSocket() { close(); }
  ListeningSocket(const ListeningSocket&) = delete;
  ListeningSocket& operator=(const ListeningSocket&) = delete;

  [[nodiscard]] int socket() const { return socket_; }
  [[nodiscard]] int port() const { return port_; }
  /// @param unacknowledged  when the other machine confirms nothing of what was sent to it for so
  /// long, the kernel ends the connection.
  /// @return a connection that does not block and sends at once; -1 with errno when there is none.
  [[nodiscard]] int accept(std::chrono::milliseconds unacknowledged) const;
  /// The kernel then refuses whoever comes.
  void close();

 private:
  int socket_ = -1;
  int port_ = 0;
};

}  // namespace stillmap::server

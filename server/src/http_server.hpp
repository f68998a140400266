#pragma once

#include "service.hpp"

#include <memory>

namespace stillmap::server {

/// Speaks HTTP/1.1 for a service: the only place that knows the HTTP library.
class HttpServer {
 public:
  /// @param service  outlives this.
  HttpServer(const ServerOptions& options, const Service& service);
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  /// @return the port. @throws std::runtime_error when it cannot be had.
  int bind();
  /// Serves until `stop`. @throws std::runtime_error when the listening socket fails.
  void run();
  /// Serves one connected socket on the calling thread until the connection ends, and closes it.
  void serve(int socket);
  /// Safe from any thread, also before `run`.
  void stop();

 private:
  class Listener;
  std::unique_ptr<Listener> listener_;
};

}  // namespace stillmap::server

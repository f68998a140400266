#pragma once

#include "http/bounded_socket.hpp"
#include "http/http_body.hpp"
#include "http/remote_address.hpp"
#include "http/request_handler.hpp"
#include "metrics/metrics.hpp"

#include <chrono>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>

namespace stillmap::server {

/// Answers the requests of connections, one at a time for each. Safe from several threads.
class HttpExchange {
 public:
  struct Limits {
    WholeBodyLimits bodies = {};
    /// Of the answers that are held in memory while they are sent, together; small ones are not
    /// counted.
    std::size_t answers_bytes = 0;
    std::size_t event_streams = 0;
    /// Share of them that one key may hold, in (0, 1].
    double client_share = 0.5;
    /// Told to clients.
    std::chrono::seconds keep_alive{0};
    /// Proxies whose X-Forwarded-For is believed.
    TrustedProxies forwarding{};
  };

  /// @param handler  outlives this.  @param metrics  may be null; outlives this.
  HttpExchange(const Limits& limits, const RequestHandler& handler, Metrics* metrics);
  ~HttpExchange();
  HttpExchange(const HttpExchange&) = delete;
  HttpExchange& operator=(const HttpExchange&) = delete;

  /// Reads one request and answers it. @param peer  address of whoever is connected.
  /// @param last  tells the client to close.
  /// @param received  called once nothing more has to come from the client but a streamed body.
  /// @return whether the connection is at the start of a next request.
  [[nodiscard]] bool serve(BoundedSocket& socket, const std::optional<IpAddress>& peer, bool last,
                           const std::function<void()>& received);
  /// From now on every answer is the last of its connection.
  void close_after_answers();
  /// Ends event streams, with a last event.
  void end_streams();
  /// Answers that are being sent end where they are.
  void cut();

 private:
  class Library;
  std::unique_ptr<Library> library_;
};

}  // namespace stillmap::server

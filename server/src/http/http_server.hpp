#pragma once

#include "http/bounded_socket.hpp"
#include "http/http_body.hpp"
#include "http/remote_address.hpp"
#include "http/request_handler.hpp"
#include "metrics/metrics.hpp"

#include <stillmap/server/server_options.hpp>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace stillmap::server {

/// Where one HTTP server listens and how much it takes.
struct Endpoint {
  std::string host;
  int port = 0;
  /// Files of the certificate; none = plain HTTP.
  TlsOptions tls;
  /// At one time.
  std::size_t connections = 1;
  std::size_t event_streams = 0;
  /// Of the answers that are being sent from memory, together.
  std::size_t answers_bytes = std::size_t{64} << 20U;
  /// Share of them that one key may hold, in (0, 1].
  double client_share = 0.5;
  WholeBodyLimits bodies = {};
  ConnectionLimits limits;
  DrainOptions drain;
  /// Most connections of one address; 0 = as many as there are.
  std::size_t connections_of_address = 0;
  TrustedProxies proxies{};
  /// How they say a client's address.
  enum class Forwarded : std::uint8_t { kNone, kHeader, kProxyProtocol };
  Forwarded forwarded = Forwarded::kNone;
};

/// @return where vehicles and people ask, out of the options.
[[nodiscard]] Endpoint main_endpoint(const ServerOptions& options);
/// @return where health and metrics are asked.
[[nodiscard]] Endpoint management_endpoint(const ServerOptions& options);

/// Speaks HTTP/1.1 for a handler: the only place that knows the HTTP library.
class HttpServer {
 public:
  /// @param handler  outlives this.
  /// @param metrics  counts requests and connections when there; outlives this.
  /// @throws maps::InputError when the certificate or its key cannot be used.
  HttpServer(const Endpoint& endpoint, const RequestHandler& handler, Metrics* metrics);
  /// The same at the main endpoint, without metrics.
  HttpServer(const ServerOptions& options, const RequestHandler& handler);
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  /// @return the port. @throws std::runtime_error when it cannot be had.
  int bind();
  /// Serves until `stop` or `drain`, and returns when the last connection is closed.
  /// @throws std::runtime_error when the listening socket fails.
  void run();
  /// Serves one connected socket on the calling thread until the connection ends, and closes it.
  void serve(int socket);
  /// Takes no new connections and ends at once what is idle; answers that are being made have
  /// `DrainOptions::timeout_s`, requests that are still coming in a second. Safe from any thread,
  /// also before `run`.
  void stop();
  /// The same once `DrainOptions::delay_s` have passed; until then everything is answered, and each
  /// client told to open its next connection elsewhere. Returns at once, safe from any thread.
  void drain();
  /// Reads certificate and key again. @return what puts them in force for connections to come, and
  /// cannot fail; nothing to do without TLS. @throws maps::InputError when they cannot be used.
  [[nodiscard]] std::function<void()> prepare_certificate();

 private:
  class Listener;
  std::unique_ptr<Listener> listener_;
};

}  // namespace stillmap::server

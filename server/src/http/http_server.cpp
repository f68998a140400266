#include "http/http_server.hpp"

#include "errors/api_error.hpp"
#include "http/connection_threads.hpp"
#include "http/connections.hpp"
#include "http/http_answer.hpp"
#include "http/http_exchange.hpp"
#include "http/listening_socket.hpp"
#include "http/problem.hpp"
#include "http/proxy_protocol.hpp"
#include "http/rate_limits.hpp"
#include "http/request_id.hpp"
#include "http/turned_away.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <spdlog/spdlog.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <functional>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

namespace stillmap::server {
namespace {

using Clock = std::chrono::steady_clock;

/// How long a stop waits for what clients are still sending: they can send it again elsewhere.
constexpr std::chrono::seconds kReceiveGrace(1);

/// Whoever starts the server often allows it 1024 files, of which each connection is one.
void allow_files(std::size_t connections) {
  constexpr std::size_t kOthers = 512;
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  const rlim_t wanted = connections + kOthers;
  if (limit.rlim_cur < wanted) {
    limit.rlim_cur = std::min<rlim_t>(wanted, limit.rlim_max);
    ::setrlimit(RLIMIT_NOFILE, &limit);
  }
  if (limit.rlim_cur < wanted) {
    spdlog::warn("{} open files are allowed, {} connections may need {}", limit.rlim_cur,
                 connections, wanted);
  }
}

/// For a connection that is not read.
std::string answer_unread(const ApiError& error) {
  const std::string id = new_request_id();
  const HttpResponse response = problem_response(error, id);
  std::string text = fmt::format(
      "HTTP/1.1 {}\r\nContent-Type: {}\r\nContent-Length: {}\r\n"
      "Connection: close\r\nRetry-After: 1\r\nX-Request-Id: {}\r\nDate: {}\r\n",
      response.status == 429 ? "429 Too Many Requests" : "503 Service Unavailable",
      response.content_type, response.body.size(), id, http_date());
  for (const auto& [name, value] : default_headers(false))
    text += fmt::format("{}: {}\r\n", name, value);
  return text + "\r\n" + response.body;
}

Endpoint::Forwarded forwarded_of(const ServerOptions& options) {
  if (options.forwarded == "x-forwarded-for") return Endpoint::Forwarded::kHeader;
  if (options.forwarded == "proxy") return Endpoint::Forwarded::kProxyProtocol;
  return Endpoint::Forwarded::kNone;
}

/// A client whose machine answers may take as little as `stall_timeout_s` allows.
std::chrono::milliseconds longest_unacknowledged(const ServerOptions& options) {
  return std::max<std::chrono::milliseconds>(ConnectionLimits{}.unacknowledged,
                                             std::chrono::seconds(options.stall_timeout_s));
}

}  // namespace

Endpoint main_endpoint(const ServerOptions& options) {
  return {.host = options.host,
          .port = options.port,
          .tls = options.tls,
          .connections = static_cast<std::size_t>(options.connections),
          .event_streams = static_cast<std::size_t>(options.event_streams),
          .answers_bytes = options.max_bodies_bytes,
          .client_share = options.client_share,
          .bodies = {.bytes = options.max_payload_bytes, .json_bytes = options.max_json_bytes},
          .limits = {.keep_alive = std::chrono::seconds(options.keep_alive_s),
                     .stall = std::chrono::seconds(options.stall_timeout_s),
                     .transfer = std::chrono::seconds(options.transfer_timeout_s),
                     .unacknowledged = longest_unacknowledged(options),
                     .max_head_bytes = options.max_head_bytes,
                     .max_line_bytes = options.max_head_line_bytes},
          .drain = options.drain,
          .connections_of_address = static_cast<std::size_t>(
              std::max(1.0, std::ceil(options.address_share * options.connections))),
          .proxies = TrustedProxies::parse(options.trusted_proxies).value_or(TrustedProxies{}),
          .forwarded = forwarded_of(options)};
}

Endpoint management_endpoint(const ServerOptions& options) {
  // Probes and scrapers of a few watchers.
  return {.host = options.management.host,
          .port = options.management.port,
          .tls = {},
          .connections = 32,
          .limits = {.keep_alive = std::chrono::seconds(options.keep_alive_s)},
          .drain = {.delay_s = 0, .timeout_s = 1}};
}

class HttpServer::Listener {
 public:
  Listener(const Endpoint& endpoint, const RequestHandler& handler, Metrics* metrics)
      : endpoint_(endpoint),
        metrics_(metrics),
        wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
        exchange_(
            {.bodies = endpoint.bodies,
             .answers_bytes = endpoint.answers_bytes,
             .event_streams = endpoint.event_streams,
             .client_share = endpoint.client_share,
             .keep_alive = std::chrono::floor<std::chrono::seconds>(endpoint.limits.keep_alive),
             .forwarding = endpoint.forwarded == Endpoint::Forwarded::kHeader ? endpoint.proxies
                                                                              : TrustedProxies{}},
            handler, metrics),
        threads_(endpoint.connections, [this](int socket) { serve(socket); }) {
    if (wake_ < 0) throw std::runtime_error("an event to wake up by cannot be made");
    prepare_certificate()();
  }
  ~Listener() { ::close(wake_); }
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  int bind() {
    allow_files(endpoint_.connections);
    listening_.emplace(endpoint_.host, endpoint_.port);
    return listening_->port();
  }

  void run() {
    while (const std::optional<std::chrono::milliseconds> wait = time_to_accept()) {
      accept_within(*wait);
    }
    listening_->close();
    finish_in_hand();
  }

  void serve_given(int socket) {
    connections_.add(socket);
    if (metrics_ != nullptr) metrics_->connection_opened();
    serve(socket);
  }

  void stop() {
    stopping_ = true;
    wake();
  }

  void drain() {
    Clock::rep none = 0;
    drain_begin_.compare_exchange_strong(none, Clock::now().time_since_epoch().count());
    exchange_.close_after_answers();
    wake();
  }

  std::function<void()> prepare_certificate() {
    if (!endpoint_.tls.enabled()) return [] {};
    return [this, fresh = std::make_shared<const TlsIdentity>(endpoint_.tls.certificate_file,
                                                              endpoint_.tls.key_file)] {
      if (metrics_ != nullptr) metrics_->set_certificate_end(fresh->end_unix_s());
      const std::lock_guard lock(identity_mutex_);
      identity_ = fresh;
    };
  }

  /// Serves one connected socket on the calling thread until the connection ends, and closes it.
  void serve(int handle) {
    try {
      BoundedSocket::Watcher watcher{
          .stalls =
              [this, handle](bool stalled) {
                connections_.set(handle, stalled ? Connections::State::kStalled
                                                 : Connections::State::kAnswering);
              },
          .is_cut = [this, handle] { return connections_.is_cut(handle); }};
      BoundedSocket socket(handle, endpoint_.limits, session(handle), std::move(watcher));
      converse(socket, handle);
    } catch (const std::exception& error) {
      spdlog::error("a connection ends: {}", error.what());
    }
    forget(handle);
    ::close(handle);
  }

 private:
  void wake() const {
    const std::uint64_t one = 1;
    static_cast<void>(::write(wake_, &one, sizeof(one)));
  }

  /// @return how long to wait for connections; nothing when no more are taken.
  std::optional<std::chrono::milliseconds> time_to_accept() const {
    constexpr std::chrono::milliseconds kTendEvery(100);
    constexpr std::chrono::milliseconds kLong(60'000);
    if (stopping_) return std::nullopt;
    std::chrono::milliseconds wait = turned_away_.empty() ? kLong : kTendEvery;
    if (const Clock::rep begin = drain_begin_) {
      const Clock::time_point until =
          Clock::time_point(Clock::duration(begin)) + std::chrono::seconds(endpoint_.drain.delay_s);
      if (Clock::now() >= until) return std::nullopt;
      wait = std::min(wait, std::chrono::ceil<std::chrono::milliseconds>(until - Clock::now()));
    }
    return wait;
  }

  void accept_within(std::chrono::milliseconds wait) {
    std::vector<pollfd> entries = {{.fd = listening_->socket(), .events = POLLIN, .revents = 0},
                                   {.fd = wake_, .events = POLLIN, .revents = 0}};
    turned_away_.watch(entries);
    ::poll(entries.data(), entries.size(), static_cast<int>(wait.count()));
    std::uint64_t count = 0;
    static_cast<void>(::read(wake_, &count, sizeof(count)));
    turned_away_.tend();
    if ((entries[0].revents & (POLLERR | POLLHUP | POLLNVAL)) != 0) {
      throw std::runtime_error("the listening socket failed");
    }
    if (entries[0].revents != 0) accept_all();
  }

  void accept_all() {
    constexpr int kMostInARow = 64;  // then it is time to look for a stop
    for (int i = 0; i < kMostInARow; ++i) {
      const int socket = listening_->accept(endpoint_.limits.unacknowledged);
      if (socket < 0) return look_at_failure(errno);
      admit(socket);
    }
  }

  static void look_at_failure(int why) {
    if (why != EMFILE && why != ENFILE && why != ENOBUFS && why != ENOMEM) return;
    // The connection stays in the backlog, and poll would call at once again.
    spdlog::error("no connection can be taken: {}", std::strerror(why));
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }

  void admit(int socket) {
    connections_.add(socket);
    if (metrics_ != nullptr) metrics_->connection_opened();
    const std::optional<IpAddress> peer = peer_address(socket);
    if (peer && is_counted(*peer) && !claim(socket, *peer)) {
      return turn_away(socket, "address", too_many_of_address());
    }
    // Before the places are gone, whoever holds one without using it makes room.
    if (threads_.busy() * 4 >= endpoint_.connections * 3) connections_.make_room(socket);
    if (!threads_.offer(socket)) {
      turn_away(socket, "full",
                ApiError(ErrorCode::kBusy,
                         fmt::format("{} connections are open, as many as may be; try again later",
                                     endpoint_.connections)));
    }
  }

  void turn_away(int socket, std::string_view why, const ApiError& error) {
    forget(socket);
    if (metrics_ != nullptr) metrics_->connection_refused(why);
    turned_away_.add(socket, endpoint_.tls.enabled() ? "" : answer_unread(error));
  }

  ApiError too_many_of_address() const {
    return {ErrorCode::kTooManyRequests,
            fmt::format("this address has {} connections open, its share: close some. If it is a "
                        "proxy, name it in the server's trusted_proxies; if a fleet stands behind "
                        "it, raise address_share",
                        endpoint_.connections_of_address)};
  }

  /// Proxies bring the connections of many. Loopback is this machine, or a proxy on it.
  bool is_counted(const IpAddress& peer) const {
    if (endpoint_.connections_of_address == 0 || endpoint_.proxies.contain(peer)) return false;
    return !peer.is_loopback() || endpoint_.forwarded != Endpoint::Forwarded::kNone;
  }

  bool claim(int socket, const IpAddress& client) {
    return connections_.claim(socket, client.client_network(), endpoint_.connections_of_address);
  }

  /// @param client  becomes what the proxy says. @return false when the connection must end.
  bool read_proxy_word(int handle, std::optional<IpAddress>& client) {
    if (endpoint_.forwarded != Endpoint::Forwarded::kProxyProtocol || !client ||
        !endpoint_.proxies.contain(*client))
      return true;
    const std::optional<ProxyHeader> header = read_proxy_header(handle, endpoint_.limits.head);
    if (!header) {
      if (metrics_ != nullptr) metrics_->connection_refused("proxy");
      if (proxy_warnings_.take({}, {.requests_per_s = 1.0 / 60.0, .burst = 1}) > 0.0) return false;
      spdlog::warn(
          "{}: found no PROXY header, expected one, as forwarded says: set send-proxy in "
          "the proxy, or take the address out of trusted_proxies",
          client->text());
      return false;
    }
    if (!header->source) return true;
    client = header->source;
    if (!is_counted(*client) || claim(handle, *client)) return true;
    if (metrics_ != nullptr) metrics_->connection_refused("address");
    return false;
  }

  void forget(int socket) {
    connections_.remove(socket);
    if (metrics_ != nullptr) metrics_->connection_closed();
  }

  void converse(BoundedSocket& socket, int handle) {
    // So that no client keeps the server from balancing connections anew.
    constexpr int kMostRequests = 10'000;
    std::optional<IpAddress> peer = peer_address(handle);
    if (!read_proxy_word(handle, peer)) return;
    if (!socket.handshake()) {
      if (metrics_ != nullptr) metrics_->connection_refused("tls");
      return;
    }
    for (int left = kMostRequests; left > 0; --left) {
      connections_.set(handle, Connections::State::kIdle);
      // Looked at after the state is set: a stop first says that it stops, then wakes the idle.
      if (closed_ || !socket.wait_for_request()) return socket.finish_idle();
      connections_.set(handle, Connections::State::kReceiving);
      const bool goes_on = exchange_.serve(socket, peer, left == 1, [&] {
        connections_.set(handle, Connections::State::kAnswering);
      });
      if (!goes_on) return socket.finish();
    }
  }

  std::unique_ptr<TlsSession> session(int handle) {
    const std::lock_guard lock(identity_mutex_);
    return identity_ ? identity_->session(handle) : nullptr;
  }

  void finish_in_hand() {
    closed_ = true;
    exchange_.close_after_answers();
    exchange_.end_streams();
    const Clock::time_point begin = Clock::now();
    while (threads_.busy() > 0) {
      connections_.interrupt(Connections::State::kIdle);
      const Clock::duration passed = Clock::now() - begin;
      if (passed > kReceiveGrace) connections_.interrupt(Connections::State::kReceiving);
      if (passed > std::chrono::seconds(endpoint_.drain.timeout_s)) {
        exchange_.cut();
        connections_.cut();
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    threads_.finish();
  }

  Endpoint endpoint_;
  Metrics* metrics_;
  int wake_;
  std::optional<ListeningSocket> listening_;
  std::atomic<bool> stopping_ = false;
  /// Of `Clock`; 0 = not draining.
  std::atomic<Clock::rep> drain_begin_ = 0;
  std::atomic<bool> closed_ = false;
  std::mutex identity_mutex_;
  std::shared_ptr<const TlsIdentity> identity_;
  HttpExchange exchange_;
  Connections connections_;
  /// A proxy may open connections only to see whether it can.
  RateLimits proxy_warnings_;
  TurnedAway turned_away_;
  /// Last: its threads use all of the above.
  ConnectionThreads threads_;
};

HttpServer::HttpServer(const Endpoint& endpoint, const RequestHandler& handler, Metrics* metrics)
    : listener_(std::make_unique<Listener>(endpoint, handler, metrics)) {}
HttpServer::HttpServer(const ServerOptions& options, const RequestHandler& handler)
    : HttpServer(main_endpoint(options), handler, nullptr) {}
HttpServer::~HttpServer() = default;

int HttpServer::bind() { return listener_->bind(); }
void HttpServer::run() { listener_->run(); }
void HttpServer::serve(int socket) { listener_->serve_given(socket); }
void HttpServer::stop() { listener_->stop(); }
void HttpServer::drain() { listener_->drain(); }
std::function<void()> HttpServer::prepare_certificate() { return listener_->prepare_certificate(); }

}  // namespace stillmap::server

#include "http/http_exchange.hpp"

#include "errors/api_error.hpp"
#include "http/header_text.hpp"
#include "http/http_answer.hpp"
#include "http/http_body.hpp"
#include "http/http_range.hpp"
#include "http/problem.hpp"
#include "http/request_head.hpp"
#include "http/request_id.hpp"
#include "http/shared_places.hpp"
#include "log/access_log.hpp"
#include "log/log_context.hpp"
#include "log/trace_context.hpp"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <httplib.h>
#undef _res  // A macro of <resolv.h>, and a name in Eigen.

#include <algorithm>
#include <atomic>
#include <cstring>
#include <optional>
#include <string>
#include <utility>

namespace stillmap::server {
namespace {

/// One request on its way through the library's hooks, which all run on the connection's thread.
struct Exchange {
  BoundedSocket& socket;
  const std::function<void()>& received;
  bool last = false;
  /// Of a head that is no request.
  std::optional<ApiError> refusal{};
  RequestHead head{};
  HttpRequest request{};
  Router::Match match{};
  /// Who is named in what is logged meanwhile.
  std::optional<LogScope> log{};
  std::chrono::steady_clock::time_point begun = std::chrono::steady_clock::now();
  std::uint64_t received_bytes = 0;
  /// Whether the connection is at the start of a next request after this one.
  bool reusable = false;
  /// What the client is told of it.
  bool keeps = false;
  /// Memory for the answer.
  std::shared_ptr<void> answer_place{};
};
thread_local Exchange* current_exchange = nullptr;

/// What the library sees of a request: the target, whose decoding is its work, and whether the
/// answer may be packed. Its own reading of headers decodes percent signs in them, its ranges and
/// its multipart bodies run recursive regular expressions, and brotli at its slowest setting would
/// take a second for each megabyte.
std::string head_for_library(const Exchange& exchange) {
  if (exchange.refusal) return "GET / HTTP/1.1\r\n\r\n";
  return fmt::format(
      "{} {} HTTP/1.1\r\n{}\r\n", exchange.head.method == "HEAD" ? "HEAD" : "GET",
      exchange.head.target,
      takes_gzip(exchange.head.value("accept-encoding")) ? "Accept-Encoding: gzip\r\n" : "");
}

/// Reads from a head in memory, writes to the connection.
class HeadStream final : public httplib::Stream {
 public:
  HeadStream(BoundedSocket& socket, std::string head) : socket_(socket), head_(std::move(head)) {}

  bool is_readable() const override { return read_ < head_.size(); }
  bool is_writable() const override { return socket_.can_write(); }
  ssize_t read(char* to, std::size_t size) override {
    const std::size_t count = std::min(size, head_.size() - read_);
    std::memcpy(to, head_.data() + read_, count);
    read_ += count;
    return static_cast<ssize_t>(count);
  }
  ssize_t write(const char* from, std::size_t size) override { return socket_.write(from, size); }
  void get_remote_ip_and_port(std::string&, int&) const override {}
  void get_local_ip_and_port(std::string&, int&) const override {}
  // The library refuses numbers above 1023, since it could not `select` them. We poll.
  socket_t socket() const override { return INVALID_SOCKET; }

 private:
  BoundedSocket& socket_;
  std::string head_;
  std::size_t read_ = 0;
};

ApiError head_too_large() {
  return {ErrorCode::kHeaderTooLarge,
          "the request line or a header is too long, or there are too many"};
}

/// A trace that the caller has begun goes on in the log; one that is not well formed, or sent
/// twice, counts as not sent.
LogContext log_context(const Exchange& exchange) {
  LogContext context;
  context.request_id = exchange.request.request_id;
  if (exchange.request.server_request_id != context.request_id)
    context.server_request_id = exchange.request.server_request_id;
  context.source = exchange.request.remote_address;
  if (exchange.head.count("traceparent") != 1) return context;
  const std::optional<Span> caller = parse_traceparent(exchange.head.value("traceparent"));
  if (!caller) return context;
  const Span own = child_of(*caller);
  context.trace_id = own.trace_id;
  context.span_id = own.span_id;
  return context;
}

void read_into(Exchange& exchange, BoundedSocket::HeadState state, const std::string& text) {
  try {
    if (state == BoundedSocket::HeadState::kTooLarge) throw head_too_large();
    exchange.head = parse_head(text);
  } catch (const ApiError& error) {
    exchange.refusal = error;
  }
  HttpRequest& request = exchange.request;
  request.server_request_id = new_request_id();
  request.request_id =
      request_id_from(exchange.head.value("x-request-id"), request.server_request_id);
}

void complete_request(Exchange& exchange, const httplib::Request& from) {
  HttpRequest& request = exchange.request;
  request.method = exchange.head.method;
  request.path = from.path;
  request.query.assign(from.params.begin(), from.params.end());
  for (const auto& [name, value] : exchange.head.fields) request.headers.emplace(name, value);
  request.client_gone = [&socket = exchange.socket] { return socket.peer_left(); };
}

void invite_body(Exchange& exchange, std::uint64_t length) {
  // HTTP/1.0 knows no interim answers (RFC 9110, 10.1.1).
  if (length == 0 || exchange.head.old_version ||
      lower(exchange.head.value("expect")) != "100-continue")
    return;
  constexpr std::string_view kContinue = "HTTP/1.1 100 Continue\r\n\r\n";
  static_cast<void>(exchange.socket.write(kContinue.data(), kContinue.size()));
}

/// As many as the page has files would else be routes of their own in the metrics.
std::string_view route_label(const Router::Match& match) {
  if (match.route == nullptr) return {};
  const std::string_view pattern = match.route->pattern;
  return pattern.starts_with("/assets/") ? "/assets/{file}" : pattern;
}

std::uint64_t size_of(const HttpResponse& response) {
  return response.source ? response.source->size() : response.body.size();
}

}  // namespace

class HttpExchange::Library final : public httplib::Server {
 public:
  Library(const Limits& limits, const RequestHandler& handler, Metrics* metrics)
      : limits_(limits), handler_(handler), metrics_(metrics) {
    // Any number that is none of "not there": the library sends nothing piece by piece without.
    svr_sock_ = 0;
    set_pre_routing_handler([this](const httplib::Request& from, httplib::Response& to) {
      answer(from, to);
      return HandlerResponse::Handled;
    });
    set_error_handler(
        [this](const httplib::Request&, httplib::Response& to) { describe_error(to); });
    set_post_routing_handler(
        [this](const httplib::Request&, httplib::Response& to) { tell_connection(to); });
  }

  bool serve(BoundedSocket& socket, const std::optional<IpAddress>& peer, bool last,
             const std::function<void()>& received) {
    std::string text;
    const BoundedSocket::HeadState state = socket.read_head(text);
    if (state == BoundedSocket::HeadState::kEnded) return false;
    Exchange exchange{.socket = socket, .received = received, .last = last};
    read_into(exchange, state, text);
    if (peer) {
      exchange.request.remote_address =
          forwarded_address(*peer, exchange.head.values("x-forwarded-for"), limits_.forwarding)
              .text();
    }
    exchange.log.emplace(log_context(exchange));
    HeadStream stream(socket, head_for_library(exchange));
    current_exchange = &exchange;
    bool closed = false;
    const bool answered = process_request(stream, false, closed, {});
    current_exchange = nullptr;
    return answered && exchange.keeps;
  }
  void close_after_answers() { closing_ = true; }
  void end_streams() { stopping_ = true; }
  void cut() { svr_sock_ = INVALID_SOCKET; }

 private:
  void answer(const httplib::Request& from, httplib::Response& to) {
    Exchange& exchange = *current_exchange;
    if (metrics_ != nullptr) metrics_->request_begun();
    HttpResponse response;
    try {
      response = respond(exchange, from);
    } catch (const ApiError& error) {
      response = refuse(exchange, error);
    } catch (const std::exception& error) {
      spdlog::error("{}", error.what());
      response = refuse(exchange, {ErrorCode::kInternalError, "the log says more"});
    }
    exchange.received();
    // Free for others before the client hears the answer, and so may send its next request.
    exchange.request.reservation.reset();
    spare_bodies_.give(std::exchange(exchange.request.body, {}));
    send(exchange, std::move(response), to);
  }

  /// @throws ApiError for what is refused before its handler sees it.
  HttpResponse respond(Exchange& exchange, const httplib::Request& from) {
    if (exchange.refusal) throw ApiError(*exchange.refusal);
    complete_request(exchange, from);
    const std::optional<std::uint64_t> length = announced_length(exchange.head);
    exchange.reusable = length.value_or(0) == 0 && exchange.head.count("transfer-encoding") == 0;
    exchange.match = handler_.find(exchange.request);
    handler_.admit(exchange.request, exchange.match);
    exchange.log->context().key_id = exchange.request.caller.key_id;
    const Route& route = *exchange.match.route;
    if (exchange.head.method == "GET") static_cast<void>(parse_range(exchange.head.value("range")));
    check_body(exchange.head, length, route, limits_.bodies);
    if (route.body != BodyKind::kNone) return respond_to_body(exchange, length.value_or(0));
    exchange.received();
    return handler_.handle(exchange.request, exchange.match);
  }

  HttpResponse respond_to_body(Exchange& exchange, std::uint64_t length) {
    HttpRequest& request = exchange.request;
    invite_body(exchange, length);
    SocketBody body(exchange.socket, length);
    if (exchange.match.route->body == BodyKind::kWhole) {
      request.body =
          read_whole(body, exchange.head,
                     most_whole_bytes(exchange.head, *exchange.match.route, limits_.bodies),
                     spare_bodies_.take(length));
      request.received = std::chrono::steady_clock::now();
    } else {
      request.stream = &body;
    }
    exchange.received();
    HttpResponse response = handler_.handle(request, exchange.match);
    request.stream = nullptr;
    exchange.reusable = body.is_read();
    exchange.received_bytes = request.body.empty() ? length - body.left() : request.body.size();
    return response;
  }

  HttpResponse refuse(const Exchange& exchange, const ApiError& error) const {
    if (metrics_ != nullptr) metrics_->problem(error.code());
    return problem_response(error, exchange.request.request_id);
  }

  void send(Exchange& exchange, HttpResponse&& response, httplib::Response& to) {
    AnswerContext context{.head = exchange.head,
                          .request_id = exchange.request.request_id,
                          .socket = exchange.socket,
                          .stopping = stopping_,
                          .event_slot = {}};
    const std::uint64_t size = size_of(response);
    try {
      if (response.events) context.event_slot = take_event_slot(exchange.request.caller);
      exchange.answer_place = take_answer_place(response.body.size());
      fill_answer(to, std::move(response), context);
    } catch (const ApiError& error) {
      fill_answer(to, refuse(exchange, error), context);
    }
    note(exchange, to.status, size);
    exchange.socket.restart_send();
  }

  /// Clients that take their answers slowly must not fill the memory.
  std::shared_ptr<void> take_answer_place(std::size_t bytes) {
    constexpr std::size_t kSmall = std::size_t{64} << 10U;
    if (bytes <= kSmall) return {};
    std::shared_ptr<void> place(
        this, [bytes](void* self) { static_cast<Library*>(self)->answers_bytes_ -= bytes; });
    answers_bytes_ += bytes;
    if (answers_bytes_ > limits_.answers_bytes)
      throw ApiError(ErrorCode::kBusy, "too many large answers are being sent; ask again later")
          .with_header("Retry-After", "1");
    return place;
  }

  std::shared_ptr<void> take_event_slot(const Caller& caller) {
    std::shared_ptr<void> place =
        event_places_.take(static_cast<int>(limits_.event_streams), caller.key_id, "event streams",
                           limits_.client_share, ErrorCode::kTooManyStreams);
    if (metrics_ == nullptr) return place;
    metrics_->event_stream_opened();
    return {this, [place = std::move(place)](void* self) mutable {
              place.reset();
              static_cast<Library*>(self)->metrics_->event_stream_closed();
            }};
  }

  void note(Exchange& exchange, int status, std::uint64_t size) const {
    const HttpRequest& request = exchange.request;
    // Also of one that was refused by its head.
    exchange.log->context().key_id = request.caller.key_id;
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - exchange.begun;
    log_access({.method = request.method,
                .route = route_label(exchange.match),
                .status = status,
                .bytes_in = exchange.received_bytes,
                .bytes_out = size,
                .milliseconds = took.count() * 1e3});
    if (metrics_ == nullptr) return;
    metrics_->request_answered({.method = request.method,
                                .route = route_label(exchange.match),
                                .status = status,
                                .seconds = took.count(),
                                .received_bytes = exchange.received_bytes,
                                .sent_bytes = size});
  }

  /// Called for every answer of 400 and above. Ours have a body already; what the library refuses
  /// by itself is a target that it cannot take apart.
  void describe_error(httplib::Response& to) {
    if (!to.body.empty()) return;
    Exchange& exchange = *current_exchange;
    if (metrics_ != nullptr) metrics_->request_begun();
    send(exchange, refuse(exchange, {ErrorCode::kInvalidRequest, "the target is not understood"}),
         to);
  }

  /// The last word on the head of an answer: the library's own on connections would say something
  /// else than what is done.
  void tell_connection(httplib::Response& to) const {
    Exchange& exchange = *current_exchange;
    exchange.keeps =
        exchange.reusable && !exchange.last && !closing_ && !exchange.head.wants_close();
    to.headers.erase("Connection");
    to.headers.erase("Keep-Alive");
    if (!exchange.keeps) to.set_header("Connection", "close");
    if (exchange.keeps && exchange.head.old_version) to.set_header("Connection", "keep-alive");
    if (exchange.keeps) {
      to.set_header("Keep-Alive", fmt::format("timeout={}", limits_.keep_alive.count()));
    }
    // An answer without a body says nothing of the length of the one that it stands for.
    if (to.status == 304 || to.status == 204) to.headers.erase("Content-Length");
  }

  Limits limits_;
  const RequestHandler& handler_;
  Metrics* metrics_;
  SpareBodies spare_bodies_;
  SharedPlaces event_places_;
  std::atomic<std::size_t> answers_bytes_ = 0;
  std::atomic<bool> closing_ = false;
  std::atomic<bool> stopping_ = false;
};

HttpExchange::HttpExchange(const Limits& limits, const RequestHandler& handler, Metrics* metrics)
    : library_(std::make_unique<Library>(limits, handler, metrics)) {}
HttpExchange::~HttpExchange() = default;

bool HttpExchange::serve(BoundedSocket& socket, const std::optional<IpAddress>& peer, bool last,
                         const std::function<void()>& received) {
  return library_->serve(socket, peer, last, received);
}
void HttpExchange::close_after_answers() { library_->close_after_answers(); }
void HttpExchange::end_streams() { library_->end_streams(); }
void HttpExchange::cut() { library_->cut(); }

}  // namespace stillmap::server

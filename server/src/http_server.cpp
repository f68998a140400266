#include "http_server.hpp"

#include "api_error.hpp"
#include "bounded_socket.hpp"
#include "header_text.hpp"
#include "request_id.hpp"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

// After everything that brings in Eigen: it defines macros that break Eigen's headers.
#include <httplib.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <limits>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

namespace stillmap::server {
namespace {

/// What one request needs to hand on between the library's hooks, which all run on the connection's
/// thread.
struct Exchange {
  explicit Exchange(BoundedSocket& from) : socket(from) {}

  BoundedSocket& socket;
  std::string request_id;
  std::string content_type;
  /// As the client asked, first and last byte; -1 where it left one out.
  httplib::Ranges ranges;
  /// Admitted by its head, waiting for its body.
  HttpRequest request;
  Router::Match match;
  /// Whether the connection is at the start of a next request after this one.
  bool reusable = false;
};
thread_local Exchange* current_exchange = nullptr;

class SocketStream final : public httplib::Stream {
 public:
  explicit SocketStream(BoundedSocket& socket) : socket_(socket) {}

  bool is_readable() const override { return true; }
  bool is_writable() const override { return socket_.can_write(); }
  ssize_t read(char* to, std::size_t size) override { return socket_.read(to, size); }
  ssize_t write(const char* from, std::size_t size) override { return socket_.write(from, size); }
  void get_remote_ip_and_port(std::string&, int&) const override {}
  void get_local_ip_and_port(std::string&, int&) const override {}
  socket_t socket() const override { return socket_.socket(); }

 private:
  BoundedSocket& socket_;
};

/// Takes away what the library would do badly with bytes from outside.
void prepare(httplib::Request& request, Exchange& exchange) {
  exchange.request_id = request_id_from(request.get_header_value("X-Request-Id"));
  // Its multipart reader and its ranges are replaced by ours and by none.
  exchange.content_type = request.get_header_value("Content-Type");
  request.headers.erase("Content-Type");
  exchange.ranges = std::exchange(request.ranges, {});
  // It would prefer brotli at its slowest setting, a second of work for each megabyte.
  const bool gzip = request.get_header_value("Accept-Encoding").find("gzip") != std::string::npos;
  request.headers.erase("Accept-Encoding");
  if (gzip) request.headers.emplace("Accept-Encoding", "gzip");
}

HttpRequest to_request(const httplib::Request& from, const Exchange& exchange) {
  HttpRequest request;
  request.method = from.method;
  request.path = from.path;
  request.query.assign(from.params.begin(), from.params.end());
  for (const auto& [name, value] : from.headers) request.headers.emplace(lower(name), value);
  if (!exchange.content_type.empty()) request.headers["content-type"] = exchange.content_type;
  request.request_id = exchange.request_id;
  return request;
}

void fill(httplib::Response& to, HttpResponse&& from, const Exchange& exchange) {
  to.status = from.status;
  to.set_header("X-Request-Id", exchange.request_id);
  to.set_header("X-Content-Type-Options", "nosniff");
  to.set_header("Accept-Ranges", from.source ? "bytes" : "none");
  for (const auto& [name, value] : from.headers) to.set_header(name, value);
  if (!from.content_type.empty()) to.set_header("Content-Type", from.content_type);
  to.body = std::move(from.body);
}

/// The part of a body that is sent.
struct Part {
  std::uint64_t first = 0;
  std::uint64_t size = 0;
};

/// @param range  first and last byte, -1 where left out ("-500" is the last 500).
/// @throws ApiError when it lies outside of the body.
Part part_of(const httplib::Range& range, std::uint64_t size) {
  const auto all = static_cast<std::int64_t>(size);
  std::int64_t first = range.first;
  std::int64_t last = range.second < 0 ? all - 1 : std::min<std::int64_t>(range.second, all - 1);
  if (first < 0) {
    first = std::max<std::int64_t>(0, all - range.second);
    last = all - 1;
  }
  if (first > last) {
    throw ApiError(ErrorCode::kRangeNotSatisfiable, "the range lies beyond the body")
        .with_header("Content-Range", fmt::format("bytes */{}", size));
  }
  return {static_cast<std::uint64_t>(first), static_cast<std::uint64_t>(last - first + 1)};
}

/// Sends a source, or the one range of it that was asked for.
void fill_from_source(httplib::Response& to, HttpResponse&& from, const Exchange& exchange) {
  const std::shared_ptr<BodySource> source = std::move(from.source);
  const std::uint64_t size = source->size();
  Part part{0, size};
  if (exchange.ranges.size() == 1 && from.status == 200) {
    part = part_of(exchange.ranges.front(), size);
    from.status = 206;
    from.headers.emplace_back("Content-Range", fmt::format("bytes {}-{}/{}", part.first,
                                                           part.first + part.size - 1, size));
  }
  fill(to, std::move(from), exchange);
  to.set_header("Accept-Ranges", "bytes");
  const std::string type = to.get_header_value("Content-Type");
  to.headers.erase("Content-Type");
  to.set_content_provider(part.size, type,
                          [source, part, id = exchange.request_id](
                              std::size_t offset, std::size_t left, httplib::DataSink& sink) {
                            std::array<char, std::size_t{64} << 10U> piece{};
                            const std::size_t count = std::min(left, piece.size());
                            try {
                              source->read(part.first + offset, std::span(piece).first(count));
                            } catch (const std::exception& error) {
                              spdlog::error("{} the answer ends early: {}", id, error.what());
                              return false;
                            }
                            return sink.write(piece.data(), count);
                          });
}

void fill_from_events(httplib::Response& to, HttpResponse&& from, const Exchange& exchange,
                      const std::atomic<bool>& stopping) {
  const std::shared_ptr<EventSource> events = std::move(from.events);
  fill(to, std::move(from), exchange);
  to.set_header("Cache-Control", "no-store");
  to.headers.erase("Content-Type");
  to.set_chunked_content_provider(
      "text/event-stream",
      [events, &stopping, silent = 0](std::size_t, httplib::DataSink& sink) mutable {
        constexpr int kCommentAfter = 60;  // a quarter of a second each
        const std::optional<std::string> text = events->next(std::chrono::milliseconds(250));
        if (!text || stopping) {
          sink.done();
          return true;
        }
        silent = text->empty() ? silent + 1 : 0;
        // A comment finds out that the client has gone, and keeps proxies from closing.
        if (silent == kCommentAfter) {
          silent = 0;
          return sink.write(":\n\n", 3);
        }
        return text->empty() || sink.write(text->data(), text->size());
      });
}

/// A body straight from the connection.
class SocketBody final : public BodyStream {
 public:
  SocketBody(BoundedSocket& socket, std::uint64_t size)
      : socket_(socket), size_(size), left_(size) {}

  [[nodiscard]] std::uint64_t size() const override { return size_; }
  [[nodiscard]] bool is_read() const { return left_ == 0; }
  std::size_t read(std::span<char> to) override {
    if (left_ == 0 || to.empty()) return 0;
    const long got = socket_.read(to.data(), std::min<std::uint64_t>(to.size(), left_));
    if (got <= 0) {
      throw ApiError(ErrorCode::kInvalidRequest,
                     fmt::format("the body ends after {} of {} bytes", size_ - left_, size_));
    }
    left_ -= static_cast<std::uint64_t>(got);
    return static_cast<std::size_t>(got);
  }

 private:
  BoundedSocket& socket_;
  std::uint64_t size_;
  std::uint64_t left_;
};

/// @throws ApiError for a body that is not taken. @return its length in bytes, as it travels;
/// nothing when it is not said.
std::optional<std::uint64_t> announced_length(const httplib::Request& request) {
  // The library reads the lines between chunks without a bound.
  if (request.has_header("Transfer-Encoding")) {
    throw ApiError(ErrorCode::kLengthRequired, "chunked bodies are not taken, send Content-Length");
  }
  const std::size_t lengths = request.get_header_value_count("Content-Length");
  if (lengths == 0) return std::nullopt;
  const std::string text = request.get_header_value("Content-Length");
  std::uint64_t length = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), length);
  if (lengths > 1 || end != text.data() + text.size() || error == std::errc::invalid_argument) {
    throw field_error(ErrorCode::kInvalidRequest, "Content-Length", "'" + text + "'", "one number");
  }
  if (error != std::errc{}) return std::numeric_limits<std::uint64_t>::max();
  return length;
}

/// @throws ApiError when the route takes no body of this length.
void check_length(std::optional<std::uint64_t> length, const Route& route,
                  const ServerOptions& options) {
  if (route.body == BodyKind::kNone) return;
  if (!length) throw ApiError(ErrorCode::kLengthRequired, "send Content-Length");
  const std::uint64_t most =
      route.body == BodyKind::kWhole ? options.max_payload_bytes : route.max_body_bytes;
  if (*length > most) {
    throw field_error(ErrorCode::kPayloadTooLarge, "body", fmt::format("{} bytes", *length),
                      fmt::format("at most {}", most));
  }
}

void check_head(const httplib::Request& request, const Exchange& exchange) {
  if (exchange.ranges.size() > 1)
    throw ApiError(ErrorCode::kRangeNotSatisfiable, "more than one range is not served");
  const std::string encoding = lower(request.get_header_value("Content-Encoding"));
  if (!encoding.empty() && encoding != "identity" && encoding != "gzip") {
    throw field_error(ErrorCode::kUnsupportedMediaType, "Content-Encoding", "'" + encoding + "'",
                      "gzip or identity");
  }
}

/// @throws ApiError when the body is too large once unpacked, or cannot be read.
std::string read_body(const httplib::ContentReader& reader, std::size_t most) {
  std::string body;
  bool too_large = false;
  const bool whole = reader([&](const char* from, std::size_t size) {
    too_large = size > most - body.size();
    if (!too_large) body.append(from, size);
    return !too_large;
  });
  if (too_large) {
    throw field_error(ErrorCode::kPayloadTooLarge, "body", "more bytes",
                      fmt::format("at most {}", most));
  }
  if (!whole)
    throw ApiError(ErrorCode::kInvalidRequest, "the body ends early or cannot be unpacked");
  return body;
}

ApiError head_too_large() {
  return {ErrorCode::kHeaderTooLarge,
          "the request line or a header is too long, or there are too many"};
}

/// Of a request line without an end the library says nothing at all.
void answer_endless_line(BoundedSocket& socket) {
  const HttpResponse response = problem_response(head_too_large(), request_id_from(""));
  const std::string text = fmt::format(
      "HTTP/1.1 {} Request Header Fields Too Large\r\nContent-Type: {}\r\nContent-Length: {}\r\n"
      "Connection: close\r\n\r\n{}",
      response.status, response.content_type, response.body.size(), response.body);
  static_cast<void>(socket.write(text.data(), text.size()));
}

/// What the library itself refused, in our words.
ApiError error_of(int http_status, const Exchange& exchange) {
  if (exchange.socket.head_too_large()) return head_too_large();
  const std::string detail = "the request is not understood as HTTP/1.1";
  switch (http_status) {
    case 404:
      return {ErrorCode::kUnknownRoute, detail};
    case 413:
      return {ErrorCode::kPayloadTooLarge, detail};
    case 416:
      return {ErrorCode::kRangeNotSatisfiable, detail};
    default:
      return {http_status >= 500 ? ErrorCode::kInternalError : ErrorCode::kInvalidRequest, detail};
  }
}

}  // namespace

class HttpServer::Listener final : public httplib::Server {
 public:
  Listener(const ServerOptions& options, const Service& service)
      : options_(options),
        service_(service),
        limits_{.keep_alive = std::chrono::seconds(options.keep_alive_s),
                .stall = std::chrono::seconds(options.stall_timeout_s),
                .transfer = std::chrono::seconds(options.transfer_timeout_s)} {
    new_task_queue = [threads = static_cast<std::size_t>(options.http_threads)] {
      return new httplib::ThreadPool(threads);
    };
    set_tcp_nodelay(true);
    set_keep_alive_max_count(10'000);
    // Only advertised by the library; the waiting is done in BoundedSocket.
    set_keep_alive_timeout(options.keep_alive_s);
    set_payload_max_length(options.max_payload_bytes);
    set_pre_routing_handler(
        [this](const auto& request, auto& response) { return answer_head(request, response); });
    const auto with_body = [this](const httplib::Request&, httplib::Response& response,
                                  const httplib::ContentReader& reader) {
      answer_body(response, reader);
    };
    Post(".*", with_body);
    Put(".*", with_body);
    Delete(".*", with_body);
    set_error_handler(
        [](const httplib::Request&, httplib::Response& response) { describe_error(response); });
  }

  int bind() {
    const int port = options_.port == 0                           ? bind_to_any_port(options_.host)
                     : bind_to_port(options_.host, options_.port) ? options_.port
                                                                  : -1;
    // The library asks for a backlog of 5, which a fleet that starts at once overflows.
    if (port < 0 || ::listen(svr_sock_, SOMAXCONN) != 0) {
      throw std::runtime_error(
          fmt::format("{}:{}: found it taken or not ours, expected a free address", options_.host,
                      options_.port));
    }
    return port;
  }

  void run() {
    if (!listen_after_bind() && !stopping_) throw std::runtime_error("the listening socket failed");
  }

  void end() {
    stopping_ = true;
    // The library's own stop does nothing until it listens, so a stop during start-up would be
    // lost.
    const socket_t socket = svr_sock_.exchange(INVALID_SOCKET);
    if (socket == INVALID_SOCKET) return;
    ::shutdown(socket, SHUT_RDWR);
    ::close(socket);
  }

 private:
  bool process_and_close_socket(socket_t handle) override {
    BoundedSocket socket(handle, limits_);
    SocketStream stream(socket);
    for (std::size_t left = keep_alive_max_count_; left > 0 && socket.wait_for_request(stopping_);
         --left) {
      Exchange exchange(socket);
      current_exchange = &exchange;
      socket.begin_request();
      bool closed = false;
      const bool last = left == 1 || stopping_;
      const bool answered = process_request(
          stream, last, closed, [&](httplib::Request& request) { prepare(request, exchange); });
      current_exchange = nullptr;
      if (!answered && socket.head_too_large()) answer_endless_line(socket);
      if (!answered || closed || last || !exchange.reusable) break;
    }
    socket.linger();
    ::close(handle);
    return true;
  }

  /// Answers what has no body to read or reads it itself, and refuses early what would be refused
  /// anyway.
  HandlerResponse answer_head(const httplib::Request& from, httplib::Response& to) {
    Exchange& exchange = *current_exchange;
    exchange.request = to_request(from, exchange);
    HttpRequest& request = exchange.request;
    try {
      const std::optional<std::uint64_t> length = announced_length(from);
      exchange.reusable = length.value_or(0) == 0;
      check_head(from, exchange);
      exchange.match = service_.admit(request);
      check_length(length, *exchange.match.route, options_);
      if (exchange.match.route->body == BodyKind::kWhole) return HandlerResponse::Unhandled;
      if (exchange.match.route->body == BodyKind::kStreamed) {
        answer_stream(*length, to);
      } else {
        finish(request, service_.handle(request, exchange.match), to);
      }
    } catch (const ApiError& error) {
      finish(request, problem_response(error, request.request_id), to);
    }
    return HandlerResponse::Handled;
  }

  void answer_body(httplib::Response& to, const httplib::ContentReader& reader) {
    Exchange& exchange = *current_exchange;
    HttpRequest& request = exchange.request;
    try {
      request.body = read_body(reader, options_.max_payload_bytes);
      exchange.reusable = true;
      request.received = std::chrono::steady_clock::now();
      finish(request, service_.handle(request, exchange.match), to);
    } catch (const ApiError& error) {
      finish(request, problem_response(error, request.request_id), to);
    }
  }

  /// @throws ApiError for a body in a content encoding: what is streamed carries its own.
  void answer_stream(std::uint64_t length, httplib::Response& to) {
    Exchange& exchange = *current_exchange;
    HttpRequest& request = exchange.request;
    const std::string encoding = request.header("content-encoding");
    if (!encoding.empty() && lower(encoding) != "identity") {
      throw field_error(ErrorCode::kUnsupportedMediaType, "Content-Encoding", "'" + encoding + "'",
                        "none");
    }
    SocketBody body(exchange.socket, length);
    request.stream = &body;
    HttpResponse response = service_.handle(request, exchange.match);
    request.stream = nullptr;
    exchange.reusable = body.is_read();
    finish(request, std::move(response), to);
  }

  void finish(const HttpRequest& request, HttpResponse&& response, httplib::Response& to) const {
    const std::chrono::duration<double, std::milli> took =
        std::chrono::steady_clock::now() - request.received;
    spdlog::debug("{} {} {} {} {} bytes {:.1f} ms", request.request_id, request.method,
                  printable(request.path), response.status, response.body.size(), took.count());
    if (!current_exchange->reusable) to.set_header("Connection", "close");
    if (response.source) {
      fill_from_source(to, std::move(response), *current_exchange);
    } else if (response.events) {
      fill_from_events(to, std::move(response), *current_exchange, stopping_);
    } else {
      fill(to, std::move(response), *current_exchange);
    }
  }

  /// Called for every answer of 400 and above; ours have a body already.
  static void describe_error(httplib::Response& response) {
    if (!response.body.empty()) return;
    Exchange& exchange = *current_exchange;
    if (exchange.request_id.empty()) exchange.request_id = request_id_from("");
    fill(response, problem_response(error_of(response.status, exchange), exchange.request_id),
         exchange);
  }

  ServerOptions options_;
  const Service& service_;
  ConnectionLimits limits_;
  std::atomic<bool> stopping_ = false;
};

HttpServer::HttpServer(const ServerOptions& options, const Service& service)
    : listener_(std::make_unique<Listener>(options, service)) {}
HttpServer::~HttpServer() = default;

int HttpServer::bind() { return listener_->bind(); }
void HttpServer::run() { listener_->run(); }
void HttpServer::stop() { listener_->end(); }

}  // namespace stillmap::server

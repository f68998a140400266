#pragma once

#include "errors/api_error.hpp"
#include "http/http_server.hpp"
#include "http/problem.hpp"
#include "raw_client.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace stillmap::server {

/// Byte i is a function of i; fails from `broken_from` on.
class PatternSource final : public BodySource {
 public:
  explicit PatternSource(std::uint64_t size, std::uint64_t broken_from = ~std::uint64_t{0})
      : size_(size), broken_from_(broken_from) {}
  static char at(std::uint64_t i) { return static_cast<char>('a' + i % 23); }
  [[nodiscard]] std::uint64_t size() const override { return size_; }
  void read(std::uint64_t offset, std::span<char> to) override {
    if (offset + to.size() > broken_from_) throw std::runtime_error("the file is gone");
    for (std::size_t i = 0; i < to.size(); ++i) to[i] = at(offset + i);
  }

 private:
  std::uint64_t size_;
  std::uint64_t broken_from_;
};

/// One event, then silence.
class QuietEvents final : public EventSource {
 public:
  std::optional<std::string> next(std::chrono::milliseconds most) override {
    if (!std::exchange(told_, true)) return "id: 1\ndata: {}\n\n";
    std::this_thread::sleep_for(most);
    return "";
  }

 private:
  bool told_ = false;
};

/// An event at each look.
class TickingEvents final : public EventSource {
 public:
  std::optional<std::string> next(std::chrono::milliseconds) override {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return "data: {}\n\n";
  }
};

/// Answers without a store: only what the transport does is looked at.
class ScriptedHandler final : public RequestHandler {
 public:
  ScriptedHandler() : router_(routes()) {}

  Router::Match find(const HttpRequest& request) const override {
    return router_.match(request.method, request.path);
  }
  void admit(HttpRequest& request, const Router::Match&) const override {
    request.caller.key_id = request.header("authorization");
    if (request.header("authorization") == "Bearer wrong")
      throw ApiError(ErrorCode::kBusy, "refused by its head").with_header("Retry-After", "1");
  }
  HttpResponse handle(const HttpRequest& request, const Router::Match& match) const override {
    ++handled;
    try {
      return match.route->handler(request, match.parameters);
    } catch (const ApiError& error) {
      return problem_response(error, request.request_id);
    }
  }

  static constexpr std::uint64_t kSourceBytes = 300'000;
  mutable std::atomic<int> handled = 0;
  mutable std::atomic<bool> hold = false;

 private:
  static HttpResponse text(std::string body) {
    return {.content_type = "text/plain", .body = std::move(body), .headers = {}};
  }
  static HttpResponse empty_source() {
    HttpResponse response{.content_type = "text/css", .body = {}, .headers = {}};
    response.source = std::make_shared<PatternSource>(0, ~std::uint64_t{0});
    return response;
  }
  static HttpResponse source(std::uint64_t broken_from) {
    HttpResponse response{.content_type = "application/octet-stream", .body = {}, .headers = {}};
    response.headers = {{"ETag", "\"v1\""}, {"Cache-Control", "private, immutable"}};
    response.source = std::make_shared<PatternSource>(kSourceBytes, broken_from);
    return response;
  }
  static HttpResponse events(std::shared_ptr<EventSource> source) {
    HttpResponse response{.content_type = {}, .body = {}, .headers = {}};
    response.events = std::move(source);
    return response;
  }
  static HttpResponse count(const HttpRequest& request) {
    std::array<char, 1000> piece;
    std::uint64_t all = 0;
    while (const std::size_t got = request.stream->read(piece)) all += got;
    return text("took " + std::to_string(all));
  }
  std::vector<Route> routes() {
    using Request = const HttpRequest&;
    using Path = const PathParameters&;
    return {
        {"GET", "/livez", [](Request, Path) { return text("alive"); }},
        {"GET", "/source", [](Request, Path) { return source(~std::uint64_t{0}); }},
        {"GET", "/empty", [](Request, Path) { return empty_source(); }},
        {"GET", "/broken", [](Request, Path) { return source(100'000); }},
        {"GET", "/events", [](Request, Path) { return events(std::make_shared<QuietEvents>()); }},
        {"GET", "/ticks", [](Request, Path) { return events(std::make_shared<TickingEvents>()); }},
        {"GET", "/slow",
         [this](Request, Path) {
           while (hold) std::this_thread::sleep_for(std::chrono::milliseconds(1));
           return text("slowly");
         }},
        {"GET", "/x/{name}", [](Request, Path path) { return text("x " + path.at("name")); }},
        {"DELETE", "/x/{name}",
         [](Request, Path) {
           return HttpResponse{.status = 204, .content_type = {}, .body = {}, .headers = {}};
         }},
        {"POST", "/echo", [](Request request, Path) { return text(request.body); }, Access::kRead,
         BodyKind::kWhole},
        {"POST", "/small", [](Request request, Path) { return text(request.body); }, Access::kRead,
         BodyKind::kWhole, 24},
        {"PUT", "/stream", [](Request request, Path) { return count(request); }, Access::kRead,
         BodyKind::kStreamed, 1'000'000},
        {"PUT", "/unread", [](Request, Path) { return text("not looked at"); }, Access::kRead,
         BodyKind::kStreamed, 100'000'000},
    };
  }

  Router router_;
};

/// A server over `ScriptedHandler` on a free port.
class TransportTest : public ::testing::Test {
 protected:
  static Endpoint small_endpoint() {
    return {.host = "127.0.0.1",
            .port = 0,
            .tls = {},
            .connections = 16,
            .event_streams = 2,
            .bodies = {.bytes = 4096, .json_bytes = 4096},
            .limits = {.keep_alive = std::chrono::seconds(1),
                       .head = std::chrono::seconds(2),
                       .stall = std::chrono::seconds(1),
                       .transfer = std::chrono::seconds(3)},
            .drain = {.delay_s = 0, .timeout_s = 5}};
  }
  void start(const Endpoint& endpoint) {
    http_.emplace(endpoint, handler_, &metrics_);
    port_ = http_->bind();
    thread_ = std::thread([this] { http_->run(); });
  }
  void TearDown() override { stop(); }
  void stop() {
    handler_.hold = false;
    if (!thread_.joinable()) return;
    http_->stop();
    thread_.join();
  }

  /// The whole answer to these bytes, up to the end of the connection.
  std::string raw(std::string_view bytes) const {
    RawClient client(port_);
    client.send(bytes);
    return client.read_to_end();
  }
  /// The same of a request without a body.
  std::string ask(const std::string& method, const std::string& target,
                  const std::string& headers = "") const {
    return raw(method + " " + target + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n" +
               headers + "\r\n");
  }
  bool alive() const { return ask("GET", "/livez").find("alive") != std::string::npos; }
  static std::string body_of(const std::string& answer) {
    return answer.substr(answer.find("\r\n\r\n") + 4);
  }

  ScriptedHandler handler_;
  Metrics metrics_{"test"};
  std::optional<HttpServer> http_;
  int port_ = 0;
  std::thread thread_;
};

}  // namespace stillmap::server

#include "http/http_answer.hpp"

#include "http/http_range.hpp"

#include <spdlog/spdlog.h>

#include <httplib.h>
#undef _res  // A macro of <resolv.h>, and a name in Eigen.

#include <algorithm>
#include <array>
#include <chrono>
#include <ctime>
#include <optional>
#include <span>
#include <utility>

namespace stillmap::server {
namespace {

std::string header_of(const HttpResponse& response, std::string_view name) {
  for (const auto& [key, value] : response.headers) {
    if (key == name) return value;
  }
  return {};
}

/// The range that is to be served: of a GET alone, and only if the client's part is of the same
/// bytes (RFC 9110, 13.1.5; a date is not compared, so it counts as another).
std::optional<ByteRange> wanted_range(const HttpResponse& response, const RequestHead& head) {
  if (response.status != 200 || head.method != "GET") return std::nullopt;
  const std::string condition = head.value("if-range");
  if (!condition.empty() && condition != header_of(response, "ETag")) return std::nullopt;
  return parse_range(head.value("range"));
}

void fill_headers(httplib::Response& to, HttpResponse& from, const AnswerContext& context) {
  to.status = from.status;
  to.set_header("X-Request-Id", context.request_id);
  to.set_header("Date", http_date());
  to.set_header("Accept-Ranges", from.source ? "bytes" : "none");
  for (const auto& [name, value] : from.headers) to.set_header(name, value);
  for (const auto& [name, value] : default_headers(context.socket.is_tls())) {
    if (!to.has_header(name)) to.set_header(name, value);
  }
  // What is text may come packed.
  if (!from.body.empty()) to.set_header("Vary", "Accept-Encoding");
}

/// Sends a source, or the part of it that was asked for.
void fill_from_source(httplib::Response& to, const std::shared_ptr<BodySource>& source,
                      const BodyPart& part, const std::string& type, const std::string& id) {
  const auto provide = [source, part, id](std::size_t offset, std::size_t left,
                                          httplib::DataSink& sink) {
    std::array<char, std::size_t{64} << 10U> piece;
    const std::size_t count = std::min(left, piece.size());
    try {
      source->read(part.first + offset, std::span(piece).first(count));
    } catch (const std::exception& error) {
      spdlog::error("{} the answer ends early: {}", id, error.what());
      return false;
    }
    return sink.write(piece.data(), count);
  };
  to.set_content_provider(part.size, type, provide);
}

/// Sends what a source of events has; called again and again by the HTTP library.
class EventSender {
 public:
  EventSender(std::shared_ptr<EventSource> events, const AnswerContext& context)
      : events_(std::move(events)),
        socket_(context.socket),
        stopping_(context.stopping),
        slot_(context.event_slot),
        id_(context.request_id) {}

  bool send(httplib::DataSink& sink) {
    try {
      return send_next(sink);
    } catch (const std::exception& error) {
      spdlog::error("{} the events end early: {}", id_, error.what());
      return false;
    }
  }

 private:
  bool send_next(httplib::DataSink& sink) {
    constexpr int kCommentAfter = 60;  // a quarter of a second each
    const std::optional<std::string> text =
        stopping_ ? std::nullopt : events_->next(std::chrono::milliseconds(250));
    if (socket_.peer_left()) return false;
    socket_.restart_send();
    if (!text || stopping_) return end(sink, text.value_or(""));
    silent_ = text->empty() ? silent_ + 1 : 0;
    // A comment keeps proxies from closing.
    if (silent_ == kCommentAfter) {
      silent_ = 0;
      return sink.write(":\n\n", 3);
    }
    return text->empty() || sink.write(text->data(), text->size());
  }
  /// @param rest  what came together with the end.
  bool end(httplib::DataSink& sink, std::string rest) const {
    if (stopping_) rest += "event: end\ndata: {\"reason\": \"stopping\"}\n\n";
    if (!rest.empty() && !sink.write(rest.data(), rest.size())) return false;
    sink.done();
    return true;
  }

  std::shared_ptr<EventSource> events_;
  BoundedSocket& socket_;
  const std::atomic<bool>& stopping_;
  std::shared_ptr<void> slot_;
  std::string id_;
  int silent_ = 0;
};

void fill_from_events(httplib::Response& to, std::shared_ptr<EventSource> events,
                      const AnswerContext& context) {
  const auto sender = std::make_shared<EventSender>(std::move(events), context);
  constexpr const char* kType = "text/event-stream";
  // nginx asks by HTTP/1.0 unless told otherwise, which has no chunks.
  if (context.head.old_version) {
    to.set_content_provider(
        kType, [sender](std::size_t, httplib::DataSink& sink) { return sender->send(sink); });
    return;
  }
  to.set_chunked_content_provider(
      kType, [sender](std::size_t, httplib::DataSink& sink) { return sender->send(sink); });
}

}  // namespace

void fill_answer(httplib::Response& to, HttpResponse&& from, const AnswerContext& context) {
  BodyPart part;
  if (from.source) {
    part.size = from.source->size();
    if (const std::optional<ByteRange> range = wanted_range(from, context.head)) {
      const std::uint64_t all = part.size;
      part = part_of(*range, all);
      from.status = 206;
      from.headers.emplace_back("Content-Range", "bytes " + std::to_string(part.first) + "-" +
                                                     std::to_string(part.first + part.size - 1) +
                                                     "/" + std::to_string(all));
    }
  }
  fill_headers(to, from, context);
  // Of a source without a byte the HTTP library would ask for more for ever.
  if (from.source && part.size > 0) {
    fill_from_source(to, from.source, part, from.content_type, context.request_id);
  } else if (from.events) {
    fill_from_events(to, std::move(from.events), context);
  } else {
    if (!from.content_type.empty()) to.set_header("Content-Type", from.content_type);
    to.body = std::move(from.body);
  }
}

std::vector<std::pair<std::string, std::string>> default_headers(bool tls) {
  std::vector<std::pair<std::string, std::string>> headers = {
      {"X-Content-Type-Options", "nosniff"},
      {"Cross-Origin-Resource-Policy", "same-origin"},
      {"Referrer-Policy", "no-referrer"},
      // The page says what it needs; nothing else is a document.
      {"Content-Security-Policy", "default-src 'none'; frame-ancestors 'none'"},
      {"Cache-Control", "no-store"}};
  if (tls) headers.emplace_back("Strict-Transport-Security", "max-age=31536000");
  return headers;
}

std::string http_date() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  ::gmtime_r(&now, &parts);
  std::array<char, 64> text{};
  // The names of days and months are English as long as nobody calls setlocale.
  const std::size_t size =
      std::strftime(text.data(), text.size(), "%a, %d %b %Y %H:%M:%S GMT", &parts);
  return {text.data(), size};
}

}  // namespace stillmap::server

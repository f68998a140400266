#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::server {

/// A body that is read piece by piece while it arrives, for what is too large to hold.
class BodyStream {
 public:
  virtual ~BodyStream() = default;
  /// Bytes in all, as announced.
  [[nodiscard]] virtual std::uint64_t size() const = 0;
  /// Waits for the next bytes, at most `to.size()`. @return how many; 0 after the last.
  /// @throws ApiError when the body ends early, or the client is too slow.
  virtual std::size_t read(std::span<char> to) = 0;
};

/// The body of an answer, read while it is sent and in any part (one range). Safe from one thread.
class BodySource {
 public:
  virtual ~BodySource() = default;
  [[nodiscard]] virtual std::uint64_t size() const = 0;
  /// Fills all of `to`. @throws std::exception when it cannot: the connection then ends early.
  virtual void read(std::uint64_t offset, std::span<char> to) = 0;
};

/// Server-sent events (text/event-stream), pulled by the connection that they go to.
class EventSource {
 public:
  virtual ~EventSource() = default;
  /// Waits for events, at most so long. @return them as they travel ("id: 7\ndata: {}\n\n"); empty
  /// when none came; nothing when no more will.
  virtual std::optional<std::string> next(std::chrono::milliseconds most) = 0;
};

/// Whoever sent a request, once its key was looked at.
struct Caller {
  /// Public part of the key; empty without keys.
  std::string key_id{};
  /// Whether it has the scope admin; also where the server has no keys.
  bool is_admin = false;
  /// Of `Access::kOpenWithNames`: whether it may be told names of maps, as far as its key goes.
  bool may_read = false;
  /// Patterns of the maps that its key is limited to; none: all maps.
  std::vector<std::string> maps{};
};

/// A request as the handlers see it: no HTTP library, no socket.
struct HttpRequest {
  std::string method;
  /// Percent-decoded, without the query.
  std::string path;
  /// Decoded; a name may come twice.
  std::vector<std::pair<std::string, std::string>> query;
  /// Names in lower case, the first value of each.
  std::map<std::string, std::string> headers;
  /// Of routes with BodyKind::kWhole, unpacked.
  std::string body;
  /// Of routes with BodyKind::kStreamed; valid during the handler.
  BodyStream* stream = nullptr;
  /// As the answer's X-Request-Id: the client's own where it sent one, which may come twice.
  std::string request_id;
  /// Made by this server, never twice. Equal to `request_id` where the client sent none.
  std::string server_request_id;
  /// Address of the client, without the port; empty where it has none.
  std::string remote_address;
  Caller caller;
  /// Whether whoever asked has closed the connection, so that the answer is of no use; safe from
  /// the handler's thread. None = there is no connection.
  std::function<bool()> client_gone;
  /// What the route's `reserve` returned; given back once the request is answered.
  std::shared_ptr<void> reservation;
  std::chrono::steady_clock::time_point received = std::chrono::steady_clock::now();

  /// @return empty when there is no such header. @param name  in lower case.
  [[nodiscard]] std::string header(const std::string& name) const {
    const auto found = headers.find(name);
    return found == headers.end() ? std::string{} : found->second;
  }
};

struct HttpResponse {
  int status = 200;
  std::string content_type;
  std::string body;
  std::vector<std::pair<std::string, std::string>> headers;
  /// In place of `body` when there: Range is served.
  std::shared_ptr<BodySource> source{};
  /// In place of `body` when there: sent until it ends, the client goes or the server stops.
  std::shared_ptr<EventSource> events{};
};

}  // namespace stillmap::server

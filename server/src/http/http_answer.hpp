#pragma once

#include "http/bounded_socket.hpp"
#include "http/http_message.hpp"
#include "http/request_head.hpp"

#include <atomic>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace httplib {
struct Response;
}

namespace stillmap::server {

/// What an answer depends on besides its content.
struct AnswerContext {
  const RequestHead& head;
  const std::string& request_id;
  /// Where it goes; outlives the answer.
  BoundedSocket& socket;
  /// Event streams end once it is set.
  const std::atomic<bool>& stopping;
  /// Held as long as events are sent.
  std::shared_ptr<void> event_slot;
};

/// Puts an answer into the HTTP library's: ranges (Range, If-Range), what is
/// sent piece by piece, headers of every answer.
/// @throws ApiError kRangeNotSatisfiable; `to` is then untouched.
void fill_answer(httplib::Response& to, HttpResponse&& from, const AnswerContext& context);

/// Headers that an answer has when its handler said nothing else, as names and values.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> default_headers(bool tls);

/// @return the time now as RFC 9110, 5.6.7 has it.
[[nodiscard]] std::string http_date();

}  // namespace stillmap::server

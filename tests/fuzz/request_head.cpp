// The head of a request as it came, what the server itself reads of its headers, and a body behind
// it that says that it is packed.
#include "http/request_head.hpp"
#include "errors/api_error.hpp"
#include "fuzz_target.hpp"
#include "http/content_digest.hpp"
#include "http/gzip.hpp"
#include "http/http_body.hpp"
#include "http/http_range.hpp"
#include "log/trace_context.hpp"

#include <algorithm>
#include <limits>
#include <span>

namespace {

using namespace stillmap;

constexpr std::size_t kMostUnpacked = 10'000;
/// What one step of the unpacking may add beyond.
constexpr std::size_t kStep = std::size_t{64} << 10U;

/// As the connection ends it, at the first empty line.
std::string_view take_head(std::string_view& text) {
  const std::size_t end = std::min(text.find("\n\n"), text.find("\n\r\n"));
  const std::size_t size =
      end == std::string_view::npos ? text.size() : text.find('\n', end + 1) + 1;
  const std::string_view head = text.substr(0, size);
  text.remove_prefix(size);
  return head;
}

std::string written(const server::RequestHead& head) {
  std::string text =
      head.method + " " + head.target + (head.old_version ? " HTTP/1.0" : " HTTP/1.1");
  for (const auto& [name, value] : head.fields) text += "\r\n" + name + ": " + value;
  return text + "\r\n\r\n";
}

void require_one_meaning(const server::RequestHead& head) {
  fuzz::require(head.target.starts_with('/') || head.target == "*", "a target");
  fuzz::require(head.count("host") <= 1 && head.count("content-length") <= 1,
                "at most one of each");
  fuzz::require(head.count("content-length") == 0 || head.count("transfer-encoding") == 0,
                "one way to tell the length");
  for (const auto& [name, value] : head.fields) {
    fuzz::require(!name.empty() && name.find_first_of(" \t:\r\n") == std::string::npos, "a name");
    fuzz::require(value.find_first_of(std::string_view("\r\n\0", 3)) == std::string::npos,
                  "a value of one line");
  }
  const server::RequestHead again = server::parse_head(written(head));
  fuzz::require(again.method == head.method && again.target == head.target &&
                    again.old_version == head.old_version && again.fields == head.fields,
                "read again as it was read");
  static_cast<void>(head.wants_close());
}

void read_range(const server::RequestHead& head) {
  const auto range =
      fuzz::taken<server::ApiError>([&] { return server::parse_range(head.value("range")); });
  if (!range || !*range) return;
  for (const std::uint64_t size : {std::uint64_t{0}, std::uint64_t{1}, std::uint64_t{1000},
                                   std::numeric_limits<std::uint64_t>::max()}) {
    const auto part = fuzz::taken<server::ApiError>([&] { return server::part_of(**range, size); });
    if (part)
      fuzz::require(part->first < size && part->size >= 1 && part->size <= size - part->first,
                    "a part lies in its body");
  }
}

void read_digest(const server::RequestHead& head) {
  server::HttpRequest request;
  for (const auto& [name, value] : head.fields) request.headers.emplace(name, value);
  const auto digest = fuzz::taken<server::ApiError>([&] { return server::wanted_sha256(request); });
  if (!digest || !*digest) return;
  request.headers["content-digest"] = server::content_digest_of(**digest);
  fuzz::require(server::wanted_sha256(request) == *digest, "a digest is told as it was read");
}

void read_trace(const server::RequestHead& head) {
  const auto span = server::parse_traceparent(head.value("traceparent"));
  if (!span) return;
  const auto again = server::parse_traceparent(server::traceparent_of(*span));
  fuzz::require(again && again->trace_id == span->trace_id && again->span_id == span->span_id &&
                    again->flags == span->flags,
                "a trace is passed on as it came");
}

void read_body_rules(const server::RequestHead& head) {
  const auto length = fuzz::taken<server::ApiError>([&] { return server::announced_length(head); });
  if (!length) return;
  for (const auto kind :
       {server::BodyKind::kNone, server::BodyKind::kWhole, server::BodyKind::kStreamed}) {
    const server::Route route{
        .method = "PUT", .pattern = "/", .handler = {}, .body = kind, .max_body_bytes = 5000};
    const auto checked = fuzz::taken<server::ApiError>([&] {
      server::check_body(head, *length, route,
                         {.bytes = kMostUnpacked, .json_bytes = kMostUnpacked});
      return true;
    });
    if (checked && kind != server::BodyKind::kNone)
      fuzz::require(*length && **length <= 5000, "bodies of a known length within bounds");
  }
}

/// @return what it says, and whether it came to its end within the bound.
std::pair<std::string, bool> unpacked(std::string_view body, std::size_t piece_size) {
  server::Gunzip gunzip;
  std::string whole;
  while (!body.empty() && whole.size() <= kMostUnpacked) {
    const std::string_view piece = body.substr(0, piece_size);
    body.remove_prefix(piece.size());
    gunzip.unpack(std::span(piece.data(), piece.size()), kMostUnpacked, whole);
    fuzz::require(whole.size() <= kMostUnpacked + kStep, "unpacking stops soon after its bound");
  }
  const bool complete = gunzip.is_complete() && whole.size() <= kMostUnpacked;
  return {std::move(whole), complete};
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::string_view text = fuzz::text_of(data, size);
  const std::string_view bytes = take_head(text);
  const auto head = fuzz::taken<server::ApiError>([&] { return server::parse_head(bytes); });
  if (!head) return 0;
  require_one_meaning(*head);
  read_range(*head);
  read_digest(*head);
  read_trace(*head);
  read_body_rules(*head);
  static_cast<void>(server::lists_tag(head->value("if-none-match"), "\"a\""));
  if (head->value("content-encoding") != "gzip") return 0;
  const auto whole = unpacked(text, text.size());
  const auto pieces = unpacked(text, 7);
  fuzz::require(whole.second == pieces.second && (!whole.second || whole.first == pieces.first),
                "the same in pieces");
  return 0;
}

// Lines of a request, as the server's own code reads them: `name=value` pairs joined by `&` (what
// the HTTP library has decoded), then a header's value, which is also read as what a proxy says of
// a client, a client's request id, and a path, which is also read as a PROXY header.
#include "handlers/flat_parameters.hpp"
#include "http/header_text.hpp"
#include "http/proxy_protocol.hpp"
#include "http/remote_address.hpp"
#include "http/request_id.hpp"
#include "http/router.hpp"
#include "pose_rules.hpp"

#include <cstring>

namespace {

using namespace stillmap;

void read_query(std::string_view text) {
  std::vector<std::pair<std::string, std::string>> query;
  while (!text.empty()) {
    std::string_view pair = fuzz::take_until(text, '&');
    const std::string_view name = fuzz::take_until(pair, '=');
    query.emplace_back(name, pair);
  }
  for (const bool takes_layout : {false, true}) {
    const auto read = fuzz::taken<server::ApiError>([&] {
      return server::read_flat_parameters(query, takes_layout, server::ScanPurpose::kQuery);
    });
    if (read) fuzz::require_bounds(*read);
  }
}

void read_header(std::string_view text) {
  const std::string_view inner = server::trimmed(text);
  fuzz::require(inner.size() <= text.size(), "trimmed is no longer");
  fuzz::require(server::media_type(text).find(';') == std::string::npos, "a type without values");
  for (const std::string_view name : {"boundary", "name", "charset"})
    fuzz::require(server::parameter_of(text, name).size() <= text.size(), "a value lies inside");
}

void read_id(std::string_view text) {
  const std::string id = server::request_id_from(text, server::new_request_id());
  fuzz::require(!id.empty() && id.size() <= 64, "an id of 1 to 64 letters");
  for (const char c : server::printable(text))
    fuzz::require(static_cast<unsigned char>(c) >= 0x20 && c != 0x7f, "no control characters");
}

void check(const server::IpAddress& address) {
  const auto again = server::IpAddress::parse(address.text());
  fuzz::require(again && again->text() == address.text(), "an address is what its text says");
}

void read_forwarded(std::string_view text) {
  const auto peer = server::IpAddress::parse("10.0.0.1");
  check(server::forwarded_address(*peer, {std::string(text), std::string(text)},
                                  *server::TrustedProxies::parse("10.0.0.0/8, 2001:db8::/32")));
  if (const auto trusted = server::TrustedProxies::parse(text))
    static_cast<void>(trusted->contain(*peer));
}

void read_proxy(std::string_view text) {
  const auto header = server::read_proxy_header([&text](std::span<char> to) {
    if (text.size() < to.size()) return false;
    std::memcpy(to.data(), text.data(), to.size());
    text.remove_prefix(to.size());
    return true;
  });
  if (header && header->source) check(*header->source);
}

void route(std::string_view text) {
  const auto handler = [](const server::HttpRequest&, const server::PathParameters&) {
    return server::HttpResponse{};
  };
  static const server::Router router(
      {{"GET", "/v1/maps/{map}", handler},
       {"POST", "/v1/maps/{map}/localize", handler},
       {"GET", "/v1/maps/{map}/versions/{version}/tiles/{l}/{x}/{y}", handler}});
  const auto match = fuzz::taken<server::ApiError>([&] { return router.match("GET", text); });
  if (!match) return;
  for (const auto& [name, value] : match->parameters) {
    fuzz::require(!value.empty() && value.find('/') == std::string::npos,
                  "a part of a path is one");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::string_view text = fuzz::text_of(data, size);
  read_query(fuzz::take_until(text, '\n'));
  const std::string_view value = fuzz::take_until(text, '\n');
  read_header(value);
  read_forwarded(value);
  read_id(fuzz::take_until(text, '\n'));
  route(text);
  read_proxy(text);
  return 0;
}

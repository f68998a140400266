#include "security/gatekeeper.hpp"

#include "errors/api_error.hpp"
#include "http/header_text.hpp"
#include "http/remote_address.hpp"
#include "store/ids_and_times.hpp"

#include <cmath>
#include <string_view>
#include <vector>

namespace stillmap::server {
namespace {

/// RFC 6750: what a client without a valid key is told.
ApiError unauthorized(ErrorCode code, const std::string& detail) {
  return ApiError(code, detail).with_header("WWW-Authenticate", "Bearer realm=\"stillmap\"");
}

/// Whether `Origin` (`scheme://host[:port]`) names the server that `Host` (`host[:port]`) names.
/// The default port of the scheme may be missing in either. Both in lower case.
bool is_same_origin(std::string_view origin, std::string_view host) {
  const std::size_t scheme_end = origin.find("://");
  if (scheme_end == std::string_view::npos) return false;  // `null`: the browser hides the origin
  const std::string_view default_port = origin.starts_with("https://") ? ":443" : ":80";
  const auto without_port = [&](std::string_view authority) {
    if (authority.ends_with(default_port)) authority.remove_suffix(default_port.size());
    return authority;
  };
  const std::string_view name = without_port(origin.substr(scheme_end + 3));
  return !name.empty() && name == without_port(host);
}

/// A browser sends simple requests of any page to any address, without asking the server first. It
/// does not add a key to them, so this is needed only where no key is asked for. `Sec-Fetch-Site`
/// is missing for plain HTTP to other machines and in old browsers; `Origin` comes with every
/// request of a page that changes something.
void refuse_other_sites(const HttpRequest& request) {
  if (request.method == "GET" || request.method == "HEAD") return;
  constexpr std::string_view kExpected =
      "a page of this server: use its own page, or make a key (stillmap keys create)";
  const std::string site = lower(request.header("sec-fetch-site"));
  if (site == "cross-site" || site == "same-site")
    throw field_error(ErrorCode::kForbidden, "Sec-Fetch-Site", site, std::string(kExpected));
  const auto origin = request.headers.find("origin");
  if (origin == request.headers.end()) return;
  if (is_same_origin(lower(origin->second), lower(request.header("host")))) return;
  throw field_error(ErrorCode::kForbidden, "Origin", "'" + origin->second + "'",
                    std::string(kExpected));
}

/// A browser that was told by DNS that another site lies here names that site.
void refuse_other_hosts(const HttpRequest& request) {
  const std::string host = lower(request.header("host"));
  const bool bracketed = host.starts_with("[");
  const std::string name =
      bracketed ? host.substr(1, host.find(']') - 1) : host.substr(0, host.find(':'));
  if (host.empty() || is_loopback(name)) return;
  throw field_error(ErrorCode::kForbidden, "Host", "'" + host + "'",
                    "localhost or a loopback address, since the store has no keys: use one of "
                    "these, or make a key (stillmap keys create)");
}

/// Any of them will do.
std::vector<KeyScope> scopes_of(Access access) {
  switch (access) {
    case Access::kLocalize:
      return {KeyScope::kLocalize};
    case Access::kWrite:
      return {KeyScope::kWrite};
    case Access::kAdmin:
      return {KeyScope::kAdmin};
    case Access::kReadOrLocalize:
      return {KeyScope::kRead, KeyScope::kLocalize};
    case Access::kLocalizeOrAdmin:
      return {KeyScope::kLocalize, KeyScope::kAdmin};
    case Access::kOpen:
    case Access::kOpenWithNames:
    case Access::kRead:
      break;
  }
  return {KeyScope::kRead};
}

void require_scope(const ApiKey& key, Access access) {
  std::string names;
  for (const KeyScope scope : scopes_of(access)) {
    if (key.scopes.has(scope)) return;
    names += (names.empty() ? "" : " or ") + std::string(name_of(scope));
  }
  throw field_error(ErrorCode::kForbidden, "Authorization", "a key without this scope", names);
}

ApiError beyond_rate(const std::string& what, double wait_s) {
  return ApiError(ErrorCode::kTooManyRequests, what)
      .with_header("Retry-After", std::to_string(std::lround(std::ceil(wait_s))));
}

}  // namespace

void Gatekeeper::admit(HttpRequest& request, Access access, const RateOptions& rate) {
  const std::optional<ApiKey> key =
      key_of(request.header("authorization"), access, request.caller.key_id);
  if (!key) {
    if (access == Access::kOpenWithNames) find_reader(request);
    if (is_open(access)) return refuse_other_sites(request);
    if (on_loopback_) refuse_other_hosts(request);
    request.caller.is_admin = true;
    refuse_other_sites(request);
    return count_address(request.remote_address, rate);
  }
  request.caller = {
      .key_id = key->id, .is_admin = key->scopes.has(KeyScope::kAdmin), .maps = key->maps};
  // What the key may not do counts too.
  if (const double wait_s = rates_.take(key->id, rate); wait_s > 0.0)
    throw beyond_rate("the key's rate is used up", wait_s);
  require_scope(*key, access);
}

/// A key that is not good is as none: a probe goes on when its key has expired.
void Gatekeeper::find_reader(HttpRequest& request) {
  try {
    if (!has_keys()) {
      if (on_loopback_) refuse_other_hosts(request);
      request.caller.may_read = true;
      return;
    }
    const ApiKey key = checked(request.header("authorization"), request.caller.key_id);
    request.caller.may_read = key.scopes.has(KeyScope::kRead);
    request.caller.maps = key.maps;
  } catch (const std::exception&) {
    // Health is told also when the store cannot be read.
    request.caller.may_read = false;
  }
}

/// Without a key all that tells clients apart is where they come from. This machine is not counted.
void Gatekeeper::count_address(const std::string& remote_address, const RateOptions& rate) {
  const std::optional<IpAddress> address = IpAddress::parse(remote_address);
  if (!address || address->is_loopback()) return;
  if (const double wait_s = address_rates_.take(address->client_network(), rate); wait_s > 0.0)
    throw beyond_rate("the rate of this address is used up", wait_s);
}

bool Gatekeeper::still_admits(const std::string& authorization, Access access) {
  try {
    std::string key_id;
    if (const auto key = key_of(authorization, access, key_id)) require_scope(*key, access);
    return true;
  } catch (const ApiError&) {
    return false;
  }
}

/// @param key_id  becomes the key's, also where the key is refused because it was revoked or has
/// expired. @return the key; nothing where none is asked for.
std::optional<ApiKey> Gatekeeper::key_of(const std::string& authorization, Access access,
                                         std::string& key_id) {
  if (is_open(access) || !has_keys()) return std::nullopt;
  return checked(authorization, key_id);
}

bool Gatekeeper::has_keys() { return keys_.any(); }

ApiKey Gatekeeper::checked(const std::string& authorization, std::string& key_id) {
  constexpr std::string_view kScheme = "bearer ";
  if (authorization.empty()) {
    throw unauthorized(ErrorCode::kMissingKey, "send Authorization: Bearer with a key");
  }
  if (lower(authorization.substr(0, kScheme.size())) != kScheme) {
    throw unauthorized(ErrorCode::kMissingKey, "Authorization: the scheme is Bearer");
  }
  const KeyCheck check =
      keys_.check(trimmed(std::string_view(authorization).substr(kScheme.size())), unix_ns());
  if (check.key) key_id = check.key->id;
  switch (check.verdict) {
    case KeyCheck::Verdict::kGood:
      return *check.key;
    case KeyCheck::Verdict::kRevoked:
      throw unauthorized(ErrorCode::kRefusedKey, "the key was revoked");
    case KeyCheck::Verdict::kExpired:
      throw unauthorized(ErrorCode::kRefusedKey, "the key has expired");
    case KeyCheck::Verdict::kUnknown:
      break;
  }
  throw unauthorized(ErrorCode::kRefusedKey, "there is no such key");
}

}  // namespace stillmap::server

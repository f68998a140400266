#pragma once

#include "http/http_message.hpp"
#include "http/rate_limits.hpp"
#include "http/router.hpp"

#include <stillmap/server/server_options.hpp>
#include "store/key_table.hpp"

#include <cstdint>
#include <optional>
#include <string>

namespace stillmap::server {

/// Says who may do what, before a request's body is read. Keys that were made or revoked meanwhile
/// count at once. Safe from several threads.
///
/// Without a single key in the store everyone may do everything but make the first key: the server
/// then listens where only this machine reaches it, unless the options say otherwise. A browser may
/// show anybody's page, though: what it sends for another site changes nothing. On loopback a name
/// that somebody points to this machine (DNS rebinding) is not answered.
class Gatekeeper {
 public:
  /// @param keys  outlives this. @param on_loopback  whether only this machine reaches the server.
  Gatekeeper(const KeyTable& keys, bool on_loopback) : keys_(keys), on_loopback_(on_loopback) {}

  /// Fills the request's caller. Where the request is refused, `key_id` is that of the key that was
  /// sent, if its secret is right.
  /// @throws ApiError kMissingKey, kRefusedKey, kForbidden; kTooManyRequests with Retry-After.
  void admit(HttpRequest& request, Access access, const RateOptions& rate);
  /// Whether whoever was admitted with this header would be still, but for the rate.
  [[nodiscard]] bool still_admits(const std::string& authorization, Access access);

 private:
  [[nodiscard]] std::optional<ApiKey> key_of(const std::string& authorization, Access access,
                                             std::string& key_id);
  [[nodiscard]] bool has_keys();
  void find_reader(HttpRequest& request);
  void count_address(const std::string& remote_address, const RateOptions& rate);
  [[nodiscard]] ApiKey checked(const std::string& authorization, std::string& key_id);

  const KeyTable& keys_;
  bool on_loopback_;
  RateLimits rates_;
  AddressRates address_rates_;
};

}  // namespace stillmap::server

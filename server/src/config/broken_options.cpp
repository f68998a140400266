#include <fmt/format.h>

#include "http/remote_address.hpp"
#include "option_table.hpp"
#include "value_text.hpp"

namespace stillmap::server {
namespace {

class Together {
 public:
  Together(const ServerOptions& options, std::vector<BrokenOption>& broken)
      : options_(options), broken_(broken) {}

  /// Keys are those of the table. @param bound  what would be right.
  void unless(bool holds, std::string_view key, std::string_view other, std::string_view bound) {
    if (holds) return;
    broken_.push_back({std::string(key), std::string(other), text_of(key),
                       fmt::format("{} ({} is {})", bound, other, text_of(other))});
  }

 private:
  [[nodiscard]] std::string text_of(std::string_view key) const {
    return value_text(find_option(key)->get(options_));
  }

  const ServerOptions& options_;
  std::vector<BrokenOption>& broken_;
};

void check_together(const ServerOptions& o, Together together) {
  together.unless(o.blobs.empty() || !o.s3.endpoint.empty(), "s3.endpoint", "blobs",
                  "the address of the S3 server");
  together.unless(o.allow_remote || is_loopback(o.host), "host", "allow_remote",
                  "a loopback address, or for clients on other machines allow_remote and a key "
                  "(stillmap keys create)");
  together.unless(o.allow_remote || !o.management.enabled() || is_loopback(o.management.host),
                  "management.host", "allow_remote",
                  "a loopback address, or for clients on other machines allow_remote and a key "
                  "(stillmap keys create)");
  together.unless(o.management.port <= 0 || o.management.port != o.port, "management.port", "port",
                  "another port");
  together.unless(o.tls.key_file.empty() || !o.tls.certificate_file.empty(), "tls.certificate_file",
                  "tls.key_file", "both or none");
  together.unless(o.tls.certificate_file.empty() || !o.tls.key_file.empty(), "tls.key_file",
                  "tls.certificate_file", "both or none");
  together.unless(o.max_json_bytes <= o.max_payload_bytes, "max_json_bytes", "max_payload_bytes",
                  "at most max_payload_bytes");
  together.unless(o.max_bodies_bytes >= o.max_payload_bytes, "max_bodies_bytes",
                  "max_payload_bytes", "at least max_payload_bytes");
  together.unless(o.max_scan_points >= o.min_scan_points, "max_scan_points", "min_scan_points",
                  "at least min_scan_points");
  together.unless(o.max_head_bytes >= o.max_head_line_bytes, "max_head_bytes",
                  "max_head_line_bytes", "at least max_head_line_bytes");
  together.unless(o.forwarded == "none" || !o.trusted_proxies.empty(), "forwarded",
                  "trusted_proxies", "none unless proxies are trusted");
  together.unless(o.event_streams < o.connections, "event_streams", "connections",
                  "below connections");
  together.unless(o.transfer_timeout_s >= o.stall_timeout_s, "transfer_timeout_s",
                  "stall_timeout_s", "at least stall_timeout_s");
  together.unless(o.quotas.store_bytes == 0 || o.quotas.map_bytes <= o.quotas.store_bytes,
                  "quotas.map_bytes", "quotas.store_bytes", "at most quotas.store_bytes");
}

}  // namespace

std::vector<BrokenOption> broken_options(const ServerOptions& options) {
  std::vector<BrokenOption> broken;
  for (const Option& option : all_options()) {
    const OptionValue value = option.get(options);
    ServerOptions scratch;
    if (option.set(scratch, value)) continue;
    broken.push_back({std::string(option.key), "", value_text(value), option.expected()});
  }
  if (!TrustedProxies::parse(options.trusted_proxies))
    broken.push_back({"trusted_proxies", "", value_text(options.trusted_proxies),
                      "addresses and networks such as 10.0.0.0/8 with commas between them"});
  check_together(options, Together(options, broken));
  return broken;
}

}  // namespace stillmap::server

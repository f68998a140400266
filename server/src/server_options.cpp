#include <stillmap/server/server_options.hpp>

#include <fmt/format.h>

#include <cstdint>
#include <limits>

namespace stillmap::server {
namespace {

class Bounds {
 public:
  template <typename Value>
  void check(const char* name, Value value, Value least, Value most) {
    if (value >= least && value <= most) return;
    broken_.push_back(fmt::format("{}: {}, in [{}, {}]", name, value, least, most));
  }
  std::vector<std::string> take() { return std::move(broken_); }

 private:
  std::vector<std::string> broken_;
};

}  // namespace

std::vector<std::string> ServerOptions::violations() const {
  constexpr std::size_t kKiB = 1024;
  Bounds bounds;
  bounds.check("port", port, 0, 65535);
  bounds.check("max_payload_bytes", max_payload_bytes, kKiB, kKiB * kKiB * kKiB);
  bounds.check("max_json_bytes", max_json_bytes, kKiB, max_payload_bytes);
  bounds.check<std::size_t>("min_scan_points", min_scan_points, 1, 20'000'000);
  bounds.check<std::size_t>("max_scan_points", max_scan_points, min_scan_points, 20'000'000);
  bounds.check("workers", workers, 0, 1024);
  bounds.check("queue", queue, 0, 10'000);
  bounds.check("max_requests", max_requests, 1, 10'000);
  bounds.check("max_bodies_bytes", max_bodies_bytes, max_payload_bytes, kKiB * kKiB * kKiB * kKiB);
  bounds.check("default_deadline_ms", default_deadline_ms, 1, 600'000);
  bounds.check("client_share", client_share, std::numeric_limits<double>::min(), 1.0);
  bounds.check("max_batch", max_batch, 1, 1024);
  bounds.check("max_sessions", max_sessions, 1, 100'000);
  bounds.check("session_idle_s", session_idle_s, 1, 86'400);
  bounds.check("clock_skew_s", clock_skew_s, 0.001, 86'400.0);
  bounds.check("http_threads", http_threads, 1, 4096);
  bounds.check("keep_alive_s", keep_alive_s, 1, 60);
  bounds.check("stall_timeout_s", stall_timeout_s, 1, 600);
  bounds.check("transfer_timeout_s", transfer_timeout_s, stall_timeout_s, 3600);
  std::vector<std::string> broken = bounds.take();
  if (!allow_remote && !is_loopback(host)) {
    broken.push_back(
        fmt::format("host: {}, a loopback address unless remote clients are allowed", host));
  }
  return broken;
}

bool is_loopback(const std::string& host) {
  // Only digits and dots after "127.", so that "127.example.org" is no loopback.
  const bool dotted =
      host.starts_with("127.") && host.find_first_not_of("0123456789.") == std::string::npos;
  return dotted || host == "::1" || host == "localhost";
}

}  // namespace stillmap::server

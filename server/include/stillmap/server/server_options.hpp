#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace stillmap::server {

/// Where the server listens, and how much it takes from one client and from all together.
struct ServerOptions {
  /// Address to listen on. Anything but loopback needs `allow_remote`, since there are no keys yet.
  std::string host = "127.0.0.1";
  /// TCP port, in [0, 65535]; 0 takes any free one.
  int port = 8080;
  /// Lets `host` be an address that other machines reach.
  bool allow_remote = false;
  /// Largest request body, unpacked [bytes], in [1 KiB, 1 GiB].
  std::size_t max_payload_bytes = std::size_t{64} << 20U;
  /// Largest JSON text [bytes], in [1 KiB, max_payload_bytes]; JSON takes some 20 times its size in
  /// memory.
  std::size_t max_json_bytes = std::size_t{8} << 20U;
  /// Most points of one scan, in [min_scan_points, 20 000 000].
  std::size_t max_scan_points = 2'000'000;
  /// Fewest points of one scan, >= 1. A scan below it is refused instead of answered with `lost`.
  std::size_t min_scan_points = 50;
  /// Alignments at one time, in [0, 1024]; 0 = as many as there are cores.
  int workers = 0;
  /// Requests that may wait for a worker, in [0, 10 000]; beyond it the answer is 503. More of them
  /// wait longer instead of trying another server.
  int queue = 16;
  /// Connections served at one time, in [1, 4096]; every idle keep-alive connection holds one of
  /// them.
  int http_threads = 64;
  /// How long a connection may idle between requests [s], in [1, 60].
  int keep_alive_s = 2;
  /// How long a client may send or take nothing [s], in [1, 600].
  int stall_timeout_s = 5;
  /// How long receiving one request may take, and sending one answer [s], in [stall_timeout_s,
  /// 3600].
  int transfer_timeout_s = 60;

  /// Every broken bound as "name: value, bound"; empty when usable.
  [[nodiscard]] std::vector<std::string> violations() const;
};

/// Whether an address is reached from this machine only (127.0.0.0/8, ::1, localhost).
[[nodiscard]] bool is_loopback(const std::string& host);

}  // namespace stillmap::server

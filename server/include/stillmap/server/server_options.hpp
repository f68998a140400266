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
  /// Requests with a body that are received, wait or are served, in [1, 10 000].
  int max_requests = 256;
  /// Their bodies together [bytes], in [max_payload_bytes, 1 TiB]; one in gzip counts as
  /// max_payload_bytes, since that is what it may become.
  std::size_t max_bodies_bytes = std::size_t{512} << 20U;
  /// Of a pose request that names none [ms], in [1, 600 000].
  int default_deadline_ms = 10'000;
  /// Share of the workers and the queue, and of the sessions, that one key may hold, in (0, 1].
  double client_share = 0.5;
  /// Scans of one batch, in [1, 1024].
  int max_batch = 32;
  /// Sessions open at one time, in [1, 100 000].
  int max_sessions = 256;
  /// A session that is not used for so long ends [s], in [1, 86 400].
  int session_idle_s = 60;
  /// A vehicle's clock that is off by more than this is told so [s], in [0.001, 86 400]; covers the
  /// time that a scan takes to arrive.
  double clock_skew_s = 2.0;
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

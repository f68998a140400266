#include "option_table.hpp"

#include <algorithm>

namespace stillmap::server {
namespace {

using Field = std::function<OptionField(ServerOptions&)>;

template <typename Value>
Field at(Value ServerOptions::*member) {
  return [member](ServerOptions& options) -> OptionField { return &(options.*member); };
}

template <typename Group, typename Value>
Field at(Group ServerOptions::*group, Value Group::*member) {
  return
      [group, member](ServerOptions& options) -> OptionField { return &(options.*group.*member); };
}

constexpr double kKiB = 1024.0;
constexpr double kMiB = 1024.0 * kKiB;
constexpr double kGiB = 1024.0 * kMiB;
/// Beyond it a double, which JSON numbers are for many readers, no longer holds every integer.
constexpr double kMostBytes = 9007199254740992.0;
constexpr double kDay = 86400.0;

std::vector<Option> listening() {
  using S = ServerOptions;
  using M = ManagementOptions;
  return {
      {.key = "store", .field = at(&S::store), .text = "Folder of the store."},
      {.key = "host",
       .field = at(&S::host),
       .text = "Address to listen on; anything but loopback needs `allow_remote`."},
      {.key = "port",
       .field = at(&S::port),
       .most = 65535,
       .text = "TCP port to listen on; 0 takes any free one."},
      {.key = "allow_remote",
       .field = at(&S::allow_remote),
       .text = "Lets `host` be an address that other machines reach."},
      {.key = "allow_without_keys",
       .field = at(&S::allow_without_keys),
       .text = "Lets such an address answer although no API key was made."},
      {.key = "management.host",
       .field = at(&S::management, &M::host),
       .text = "Address of the management port, which serves health and metrics without a key."},
      {.key = "management.port",
       .field = at(&S::management, &M::port),
       .least = -1,
       .most = 65535,
       .text = "Management port; -1 means none, 0 takes any free one."},
      {.key = "tls.certificate_file",
       .field = at(&S::tls, &TlsOptions::certificate_file),
       .text = "Certificate with its chain, in PEM; empty means no TLS."},
      {.key = "tls.key_file",
       .field = at(&S::tls, &TlsOptions::key_file),
       .text = "Private key of the certificate, in PEM."},
  };
}

std::vector<Option> admission() {
  using S = ServerOptions;
  return {
      {.key = "max_payload_bytes",
       .field = at(&S::max_payload_bytes),
       .least = kKiB,
       .most = kGiB,
       .unit = "bytes",
       .text = "Largest request body once unpacked; uploads have limits of their own."},
      {.key = "max_json_bytes",
       .field = at(&S::max_json_bytes),
       .least = kKiB,
       .most = kGiB,
       .unit = "bytes",
       .text = "Largest JSON text, at most `max_payload_bytes`."},
      {.key = "max_scan_points",
       .field = at(&S::max_scan_points),
       .least = 1,
       .most = 20'000'000,
       .unit = "points",
       .text = "Most points of one scan, at least `min_scan_points`."},
      {.key = "min_scan_points",
       .field = at(&S::min_scan_points),
       .least = 1,
       .most = 20'000'000,
       .unit = "points",
       .text = "Fewest points of one scan."},
      {.key = "max_head_bytes",
       .field = at(&S::max_head_bytes),
       .least = 4 * kKiB,
       .most = 256 * kKiB,
       .unit = "bytes",
       .text = "Request line and all headers of one request, at least `max_head_line_bytes`."},
      {.key = "max_head_line_bytes",
       .field = at(&S::max_head_line_bytes),
       .least = 512,
       .most = 4 * kKiB,
       .unit = "bytes",
       .text = "Request line, or one header."},
      {.key = "workers",
       .field = at(&S::workers),
       .most = 1024,
       .text = "Alignments at one time; 0 means as many as there are cores."},
      {.key = "queue",
       .field = at(&S::queue),
       .most = 10'000,
       .unit = "requests",
       .text = "Requests that may wait for a worker; beyond it the answer is 503."},
      {.key = "max_requests",
       .field = at(&S::max_requests),
       .least = 1,
       .most = 10'000,
       .unit = "requests",
       .text = "Requests with a body that are received, wait or are served at one time."},
      {.key = "max_bodies_bytes",
       .field = at(&S::max_bodies_bytes),
       .least = kKiB,
       .most = 1024.0 * kGiB,
       .unit = "bytes",
       .text = "Their bodies together, at least `max_payload_bytes`; one in gzip counts as that."},
      {.key = "default_deadline_ms",
       .field = at(&S::default_deadline_ms),
       .least = 1,
       .most = 600'000,
       .unit = "ms",
       .text = "Deadline of a pose request that names none."},
      {.key = "client_share",
       .field = at(&S::client_share),
       .least = 0.001,
       .most = 1,
       .text = "Share of workers and queue, and of the sessions, that one key may hold."},
      {.key = "connections",
       .field = at(&S::connections),
       .least = 1,
       .most = 4096,
       .text = "Connections served at one time."},
      {.key = "event_streams",
       .field = at(&S::event_streams),
       .most = 4095,
       .text = "Event streams open at one time, below `connections`."},
      {.key = "keep_alive_s",
       .field = at(&S::keep_alive_s),
       .least = 1,
       .most = 60,
       .unit = "s",
       .text = "How long a connection may idle between requests."},
      {.key = "stall_timeout_s",
       .field = at(&S::stall_timeout_s),
       .least = 1,
       .most = 600,
       .unit = "s",
       .text = "How long a client may send or take nothing."},
      {.key = "transfer_timeout_s",
       .field = at(&S::transfer_timeout_s),
       .least = 1,
       .most = 3600,
       .unit = "s",
       .text = "How long receiving one request may take, and sending one answer; at least "
               "`stall_timeout_s`."},
      {.key = "max_clock_skew_s",
       .field = at(&S::max_clock_skew_s),
       .most = kDay,
       .unit = "s",
       .text = "How far a vehicle's clock may be from the server's; 0 means not compared.",
       .reloadable = true},
      {.key = "rate.requests_per_s",
       .field = at(&S::rate, &RateOptions::requests_per_s),
       .most = 1e6,
       .unit = "1/s",
       .text = "Requests per second of one key in the long run; 0 means no bound.",
       .reloadable = true},
      {.key = "rate.burst",
       .field = at(&S::rate, &RateOptions::burst),
       .least = 1,
       .most = 1'000'000,
       .unit = "requests",
       .text = "Requests of one key at once after a pause.",
       .reloadable = true},
      {.key = "sessions.max",
       .field = at(&S::sessions, &SessionOptions::max),
       .most = 1'000'000,
       .text = "Sessions open at one time; beyond it the answer is 503."},
      {.key = "sessions.idle_expiry_s",
       .field = at(&S::sessions, &SessionOptions::idle_expiry_s),
       .least = 1,
       .most = kDay,
       .unit = "s",
       .text = "A session that sends no scan for so long is forgotten."},
      {.key = "batch.max_scans",
       .field = at(&S::batch, &BatchOptions::max_scans),
       .least = 1,
       .most = 10'000,
       .unit = "scans",
       .text = "Most scans of one batch.",
       .reloadable = true},
  };
}

std::vector<Option> storing() {
  using S = ServerOptions;
  using U = UploadOptions;
  using R = RetentionOptions;
  return {
      {.key = "uploads.max_package_bytes",
       .field = at(&S::uploads, &U::max_package_bytes),
       .least = kKiB,
       .most = kMostBytes,
       .unit = "bytes",
       .text = "Largest package or map file as it travels."},
      {.key = "uploads.max_entries",
       .field = at(&S::uploads, &U::max_entries),
       .least = 1,
       .most = 10'000'000,
       .unit = "files",
       .text = "Most files in one package.",
       .reloadable = true},
      {.key = "uploads.max_unpacked_ratio",
       .field = at(&S::uploads, &U::max_unpacked_ratio),
       .least = 1,
       .most = 1000,
       .text = "Unpacked bytes for each byte that travelled.",
       .reloadable = true},
      {.key = "uploads.max_drive_bytes",
       .field = at(&S::uploads, &U::max_drive_bytes),
       .least = kKiB,
       .most = kMostBytes,
       .unit = "bytes",
       .text = "Largest drive, all its parts together."},
      {.key = "uploads.max_open",
       .field = at(&S::uploads, &U::max_open),
       .least = 1,
       .most = 10'000,
       .text = "Uploads under way at one time, half of them of one key; beyond it the answer is "
               "503 or 429.",
       .reloadable = true},
      {.key = "quotas.store_bytes",
       .field = at(&S::quotas, &QuotaOptions::store_bytes),
       .most = kMostBytes,
       .unit = "bytes",
       .text = "All that the store may hold; 0 means as much as the disk.",
       .reloadable = true},
      {.key = "quotas.map_bytes",
       .field = at(&S::quotas, &QuotaOptions::map_bytes),
       .most = kMostBytes,
       .unit = "bytes",
       .text = "All versions of one map; 0 means no bound of its own.",
       .reloadable = true},
      {.key = "retention.versions",
       .field = at(&S::retention, &R::versions),
       .most = 100'000,
       .text = "Newest versions of each map that stay beside the active one; 0 means all.",
       .reloadable = true},
      {.key = "retention.job_days",
       .field = at(&S::retention, &R::job_days),
       .most = 36'500,
       .unit = "days",
       .text = "How long a finished job and its log stay; 0 means for ever.",
       .reloadable = true},
      {.key = "retention.audit_days",
       .field = at(&S::retention, &R::audit_days),
       .most = 36'500,
       .unit = "days",
       .text = "How long the audit log stays; 0 means for ever.",
       .reloadable = true},
      {.key = "retention.drive_days",
       .field = at(&S::retention, &R::drive_days),
       .most = 36'500,
       .unit = "days",
       .text = "How long an uploaded drive stays after its last use; 0 means until it is deleted.",
       .reloadable = true},
  };
}

std::vector<Option> building() {
  using S = ServerOptions;
  using J = JobOptions;
  using Q = QualityGateOptions;
  return {
      {.key = "jobs.concurrent",
       .field = at(&S::jobs, &J::concurrent),
       .least = 1,
       .most = 64,
       .text = "Rebuilds at one time."},
      {.key = "jobs.nice",
       .field = at(&S::jobs, &J::nice),
       .most = 19,
       .text = "Added to the niceness of the server, so that serving goes first.",
       .reloadable = true},
      {.key = "jobs.cores",
       .field = at(&S::jobs, &J::cores),
       .most = 1024,
       .text = "Cores that one rebuild may use; 0 means all of the machine.",
       .reloadable = true},
      {.key = "jobs.memory_bytes",
       .field = at(&S::jobs, &J::memory_bytes),
       .most = kMostBytes,
       .unit = "bytes",
       .text = "Memory that one rebuild may use; 0 means no bound of its own.",
       .reloadable = true},
      {.key = "jobs.time_limit_s",
       .field = at(&S::jobs, &J::time_limit_s),
       .least = 1,
       .most = 30 * kDay,
       .unit = "s",
       .text = "A rebuild that takes longer is ended and counts as failed.",
       .reloadable = true},
      {.key = "jobs.retries",
       .field = at(&S::jobs, &J::retries),
       .most = 100,
       .text = "How often a rebuild that crashed starts again, from its last checkpoint.",
       .reloadable = true},
      {.key = "jobs.work_dir",
       .field = at(&S::jobs, &J::work_dir),
       .text = "Folder for checkpoints, which must survive a restart; empty means in the store."},
      {.key = "gate.max_success_loss",
       .field = at(&S::gate, &Q::max_success_loss),
       .most = 1,
       .text = "Share of localized held-back scans that a rebuilt map may lose against one that "
               "keeps its movable objects.",
       .reloadable = true},
      {.key = "gate.max_new_lost",
       .field = at(&S::gate, &Q::max_new_lost),
       .most = 1'000'000,
       .unit = "scans",
       .text = "Scans that may be lost in a rebuilt map and were not in the other.",
       .reloadable = true},
      {.key = "gate.min_success_rate",
       .field = at(&S::gate, &Q::min_success_rate),
       .most = 1,
       .text = "Least share of localized held-back scans, also for a first version.",
       .reloadable = true},
      {.key = "gate.max_static_loss",
       .field = at(&S::gate, &Q::max_static_loss),
       .most = 1,
       .text = "Largest share of static points that cleaning may take.",
       .reloadable = true},
      {.key = "gate.min_coverage",
       .field = at(&S::gate, &Q::min_coverage),
       .most = 1,
       .text = "Least share of the active version's ground that a rebuilt map covers.",
       .reloadable = true},
  };
}

std::vector<Option> running() {
  using S = ServerOptions;
  using L = LogOptions;
  using D = DrainOptions;
  return {
      {.key = "log.level",
       .field = at(&S::log, &L::level),
       .text = "Least level that is logged.",
       .reloadable = true,
       .choices = {"debug", "info", "warning", "error"}},
      {.key = "log.format",
       .field = at(&S::log, &L::format),
       .text = "Lines for people, or one JSON object a line.",
       .reloadable = true,
       .choices = {"text", "json"}},
      {.key = "log.file",
       .field = at(&S::log, &L::file),
       .text = "File that is appended to and opened again at SIGHUP; empty means stderr.",
       .reloadable = true},
      {.key = "log.requests",
       .field = at(&S::log, &L::requests),
       .text = "A line for every request; those of probes at level debug.",
       .reloadable = true},
      {.key = "drain.delay_s",
       .field = at(&S::drain, &D::delay_s),
       .most = 600,
       .unit = "s",
       .text = "How long `/readyz` says 503 after SIGTERM before new connections are refused."},
      {.key = "drain.timeout_s",
       .field = at(&S::drain, &D::timeout_s),
       .least = 1,
       .most = 3600,
       .unit = "s",
       .text = "How long requests in hand may take after that."},
  };
}

std::vector<Option> make_table() {
  std::vector<Option> table;
  for (auto* part : {listening, admission, storing, building, running}) {
    std::ranges::move(part(), std::back_inserter(table));
  }
  return table;
}

}  // namespace

std::span<const Option> all_options() {
  static const std::vector<Option> table = make_table();
  return table;
}

const Option* find_option(std::string_view key) {
  const std::span<const Option> table = all_options();
  const auto found = std::ranges::find(table, key, &Option::key);
  return found == table.end() ? nullptr : &*found;
}

}  // namespace stillmap::server

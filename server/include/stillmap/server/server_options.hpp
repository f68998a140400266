#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace stillmap::server {

// A field's path is its key in the configuration file (`sessions.idle_expiry_s`); its bounds, its
// sentence for users and whether SIGHUP reloads it stand in `src/config/option_table.cpp`, its
// default here alone.

/// A second port with threads of its own, for health and `/metrics`.
struct ManagementOptions {
  std::string host = "127.0.0.1";
  /// -1 = no such port, 0 takes any free one.
  int port = -1;

  [[nodiscard]] bool enabled() const { return port >= 0; }
};

/// Files in PEM; both or none. The key itself never stands in a configuration.
struct TlsOptions {
  std::string certificate_file;
  std::string key_file;

  [[nodiscard]] bool enabled() const { return !certificate_file.empty() || !key_file.empty(); }
};

/// The server of S3 in which packages are. Credentials never stand in a configuration.
struct S3ServerOptions {
  /// Such as https://HOST or http://127.0.0.1:9000.
  std::string endpoint;
  std::string region = "us-east-1";
  /// The bucket is part of the host's name, not of the path.
  bool virtual_hosted = false;
  /// Certificates (PEM) that are trusted; empty = the system's.
  std::string ca_file;
  /// Access key and secret, mode 0600; empty = `AWS_ACCESS_KEY_ID`, ... of the environment.
  std::string credentials_file;
};

struct SessionOptions {
  /// Open at one time, over all keys; beyond it the answer is 503.
  int max = 1000;
  /// A session that no request uses for so long ends [s].
  int idle_expiry_s = 300;
};

struct BatchOptions {
  /// Most scans of one batch.
  int max_scans = 64;
};

/// What bounds an upload of any size is the free disk, the quotas and the ratio.
struct UploadOptions {
  /// Largest package or map file as it travels [bytes]; 0 = no bound.
  std::int64_t max_package_bytes = 0;
  /// Most files in one package; 0 = no bound.
  int max_entries = 0;
  /// Unpacked bytes for each byte that travelled; beyond it the upload is a bomb. Point clouds pack
  /// to a third at best, JSON to a tenth.
  double max_unpacked_ratio = 20.0;
  /// Largest drive, all its parts together [bytes]; 0 = no bound.
  std::int64_t max_drive_bytes = 0;
  /// Uploads that are under way at one time; beyond it the answer is 503.
  int max_open = 16;
};

/// Beyond a quota the answer to an upload or a rebuild is 507.
struct QuotaOptions {
  /// All that the store holds [bytes]; 0 = as much as the disk.
  std::int64_t store_bytes = 0;
  /// All versions of one map [bytes]; 0 = no bound of its own.
  std::int64_t map_bytes = 0;
  /// Of the store's disk, what uploads and rebuilds leave free [bytes]; 0 = nothing; -1 = 256 MiB,
  /// or 2 % of the disk where that is more, but at most 10 % of it.
  std::int64_t disk_reserve_bytes = -1;
};

/// What `stillmap store gc` and the server keep.
struct RetentionOptions {
  /// Newest versions of each map that stay beside the active one; 0 = all of them.
  int versions = 10;
  /// Days that a finished job and its log stay; 0 = for ever.
  int job_days = 30;
  /// Days that the audit log stays; 0 = for ever.
  int audit_days = 365;
  /// Days that an uploaded drive stays after its last use; 0 = until it is deleted.
  int drive_days = 0;
};

/// Rebuilds, each a process of its own below the serving one.
struct JobOptions {
  /// Jobs at one time.
  int concurrent = 1;
  /// Added to the niceness of the server.
  int nice = 10;
  /// Cores that one job may use; 0 = all of the machine.
  int cores = 0;
  /// Memory of one job [bytes]; 0 = no bound of its own.
  std::int64_t memory_bytes = 0;
  /// A job that takes longer is ended and counts as failed [s].
  int time_limit_s = 24 * 3600;
  /// How often a job that crashed or was killed starts again, from its last checkpoint.
  int retries = 2;
  /// Folder for checkpoints, which must survive a restart; empty = within the store.
  std::string work_dir;
  /// What builds the maps of a rebuild: `process`, or `slurm`: jobs of a cluster.
  std::string executor = "process";
  /// Of `slurm`: shares that a build is cut into.
  int slurm_units = 8;
  /// Of `slurm`: options of sbatch, with spaces between.
  std::string slurm_options;
};

/// When a rebuilt map may become the active one by itself. Shares are in [0, 1].
struct QualityGateOptions {
  /// How much lower the share of localized held-back scans may be than with the map that keeps its
  /// movable objects: one point.
  double max_success_loss = 0.01;
  /// How many scans may be `lost` that the other map localizes.
  int max_new_lost = 0;
  /// For a first version: least share of held-back scans that are found in it.
  double min_success_rate = 0.95;
  /// Largest share of static points that cleaning may take.
  double max_static_loss = 0.02;
  /// Least share of the ground within 2 m of the active version's path that the new one covers.
  double min_coverage = 0.95;
  /// How much thicker the median wall may be than in the active version, as a share.
  double max_wall_thickening = 0.25;
  /// How much higher the mean map entropy may be than that of the active version [nat].
  double max_entropy_rise = 0.2;
};

/// For each key, a token bucket; beyond it the answer is 429 with `Retry-After`.
struct RateOptions {
  /// Requests per second in the long run [1/s]; 0 = no bound.
  double requests_per_s = 200.0;
  /// Requests at once after a pause.
  int burst = 400;
};

struct LogOptions {
  /// `debug`, `info`, `warning` or `error`.
  std::string level = "info";
  /// `text`, or `json` with one object a line.
  std::string format = "text";
  /// Opened again at SIGHUP, for log rotation; empty = stderr.
  std::string file;
  /// A line for every request; those of probes at level debug.
  bool requests = true;
};

/// What happens between SIGTERM and the end.
struct DrainOptions {
  /// `/readyz` says 503 for so long before new connections are refused [s]: the time that a load
  /// balancer needs to see it; 0 where there is none.
  int delay_s = 0;
  /// Requests in hand may take so long after that [s].
  int timeout_s = 30;
};

/// Where the server listens, and how much it takes from one client and from all together.
struct ServerOptions {
  /// Folder of the store. `stillmap serve` needs it; the library is given the folder apart.
  std::string store = {};
  /// Address of the database of PostgreSQL that holds the store's state; empty where it lies in the
  /// folder. `stillmap serve` attaches the folder to it.
  std::string state = {};
  /// Where the files of packages are: `s3://BUCKET/PREFIX`; empty = in the store's folder.
  std::string blobs = {};
  /// Folder for files of packages that are in S3; empty = `cache` in the store.
  std::string cache = {};
  /// Most that it may hold [bytes].
  std::int64_t cache_bytes = std::int64_t{64} << 30U;
  /// Address to listen on. Anything but loopback needs `allow_remote`.
  std::string host = "127.0.0.1";
  /// TCP port; 0 takes any free one.
  int port = 8080;
  /// Lets `host` be an address that other machines reach.
  bool allow_remote = false;
  /// Lets such an address answer although no API key was made.
  bool allow_without_keys = false;
  /// Largest request body, unpacked [bytes], but for uploads of maps and drives.
  std::size_t max_payload_bytes = std::size_t{64} << 20U;
  /// Largest JSON text [bytes], up to max_payload_bytes.
  std::size_t max_json_bytes = std::size_t{8} << 20U;
  /// Most points of one scan, at least min_scan_points.
  std::size_t max_scan_points = 2'000'000;
  /// Fewest points of one scan. A scan below it is refused instead of answered with `lost`.
  std::size_t min_scan_points = 50;
  /// Request line and all headers of one request [bytes].
  std::size_t max_head_bytes = std::size_t{32} << 10U;
  /// Request line, or one header [bytes].
  std::size_t max_head_line_bytes = std::size_t{4} << 10U;
  /// Alignments at one time; 0 = as many as there are cores.
  int workers = 0;
  /// Requests that may wait for a worker; beyond it the answer is 503. More of them wait longer
  /// instead of trying another server.
  int queue = 16;
  /// Requests with a body that are received, wait or are served at one time.
  int max_requests = 256;
  /// Their bodies together [bytes], at least max_payload_bytes. JSON counts as eight times its
  /// bytes for the values read from it; a body in gzip as max_payload_bytes or max_json_bytes,
  /// which is what it may become.
  std::size_t max_bodies_bytes = std::size_t{512} << 20U;
  /// Of a pose request that names none [ms].
  int default_deadline_ms = 10'000;
  /// Share of the workers and the queue, of the sessions and of the event streams, that one key may
  /// hold.
  double client_share = 0.5;
  /// Connections served at one time; every idle keep-alive connection holds one of them, some 30
  /// KiB of memory each. Beyond it the answer is 503.
  int connections = 512;
  /// Share of `connections` that one address may hold (of IPv6 one network of 64 bits); beyond it
  /// the answer is 429. Trusted proxies are not counted, nor is loopback unless `forwarded` says
  /// that proxies are there.
  double address_share = 0.25;
  /// Addresses and networks of proxies whose word on a client's address is believed, with commas
  /// between them: `10.0.0.0/8, 2001:db8::1`.
  std::string trusted_proxies = {};
  /// How they say it: `none`, `x-forwarded-for` (the header), or `proxy` (the PROXY protocol,
  /// version 1 or 2, which every connection of theirs must then begin with).
  std::string forwarded = "none";
  /// Event streams open at one time, below `connections`, since each holds one of them.
  int event_streams = 64;
  /// How long a connection may idle between requests [s].
  int keep_alive_s = 2;
  /// How long a client may send or take nothing [s].
  int stall_timeout_s = 5;
  /// How long receiving one request may take, and sending one answer [s], at least stall_timeout_s.
  int transfer_timeout_s = 60;
  /// How far a vehicle's clock may be from the server's [s]; 0 = not compared, as for recorded
  /// drives.
  double max_clock_skew_s = 0.0;

  /// Folder with `MAP.json` for each map that is not localized in with the defaults; read whenever
  /// a version of the map is loaded. Empty = all have the defaults.
  std::string localization_options_dir = {};

  /// Public keys (PEM) of those who may sign versions; empty = nothing needs to be signed.
  std::string trusted_keys_file = {};

  S3ServerOptions s3 = {};
  ManagementOptions management = {};
  TlsOptions tls = {};
  SessionOptions sessions = {};
  BatchOptions batch = {};
  UploadOptions uploads = {};
  QuotaOptions quotas = {};
  RetentionOptions retention = {};
  JobOptions jobs = {};
  QualityGateOptions gate = {};
  RateOptions rate = {};
  LogOptions log = {};
  DrainOptions drain = {};

  /// Every broken bound as "name: value, bound"; empty when usable.
  [[nodiscard]] std::vector<std::string> violations() const;
};

/// Whether an address is reached from this machine only (127.0.0.0/8, ::1, localhost).
[[nodiscard]] bool is_loopback(const std::string& host);

}  // namespace stillmap::server

#pragma once

#include "errors/error_codes.hpp"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// One metric, as the table in `server/reference.md` has it.
struct MetricInfo {
  std::string_view name;
  /// `counter`, `gauge` or `histogram`.
  std::string_view type;
  /// Names of its labels, with commas between.
  std::string_view labels;
  std::string_view help;
};

/// What an operator sees of the server, in Prometheus' text format. Base units. No label holds a
/// session, a vehicle or a version: the number of series stays bounded. Safe from several threads.
class Metrics {
 public:
  /// @param version  of this program, for `stillmap_build_info`.
  explicit Metrics(const std::string& version);
  ~Metrics();
  Metrics(const Metrics&) = delete;
  Metrics& operator=(const Metrics&) = delete;

  struct AnsweredRequest {
    std::string_view method;
    /// Pattern of the route; empty when none fits.
    std::string_view route;
    int status = 0;
    double seconds = 0.0;
    std::uint64_t received_bytes = 0;
    std::uint64_t sent_bytes = 0;
  };
  void request_begun();
  void request_answered(const AnsweredRequest& request);
  /// Counts an answer that is a problem document.
  void problem(ErrorCode code);

  void connection_opened();
  void connection_closed();
  /// @param reason  a constant word: `full`, `client`, `tls`.
  void connection_refused(std::string_view reason);
  void event_stream_opened();
  void event_stream_closed();

  /// @param map  its name; beyond 200 names the label says `other`.
  /// @param status  `ok`, `degraded` or `lost`.
  void aligned(std::string_view map, std::string_view method, std::string_view status,
               double seconds);
  void queue_waited(double seconds);
  /// A scan of a session that was dropped since a newer one came.
  void scan_superseded();
  /// @param result  `begun`, `continued` or `replayed`.
  void sealed_scan(std::string_view result);
  /// @param map  in which the pose is. @param by  `prior`, `gnss` or `nothing`.
  void set_map_chosen(std::string_view map, std::string_view by);
  /// @param map  in which the vehicle goes on.
  void handed_over(std::string_view map);
  /// @param map  that was driven nearer and does not show the scan as well.
  void hand_over_refused(std::string_view map);
  void set_workers(std::size_t busy, std::size_t stuck, std::size_t all);
  void set_queue(std::size_t waiting, std::size_t places);
  void set_sessions(std::size_t open);

  void set_maps(std::size_t ready, std::size_t loading, std::size_t failed);
  void map_loaded(std::string_view map, double seconds);
  void map_load_failed(std::string_view map);
  /// Revisions of the maps that are served, by name: all that there are; maps that had one before
  /// are set to 0.
  void set_map_revisions(const std::map<std::string, std::int64_t>& revisions);

  struct RolloutFigure {
    std::string map;
    double share = 0.0;
    bool halted = false;
  };
  /// All that there are; maps that had one before are set to 0.
  void set_rollouts(const std::vector<RolloutFigure>& rollouts);
  /// @param group  `rollout` or `others`.
  void rollout_answered(std::string_view map, std::string_view group, std::string_view status);

  /// @param status  `enqueued` or `processing`.
  void set_jobs(std::string_view status, std::size_t count);
  /// @param status  `succeeded`, `failed` or `canceled`.
  void job_ended(std::string_view status, double seconds);

  /// Of the store's disk, and whether the store takes changes.
  void set_store_disk(std::uint64_t free_bytes, std::uint64_t reserve_bytes, bool writable);
  void set_store_bytes(std::uint64_t used_bytes);
  /// Since the state in PostgreSQL answered last.
  void set_state_silence(double seconds);
  /// Something was done that the audit log does not tell of.
  void audit_missed();

  /// Of packages in S3; counts since the program began.
  struct BlobFigures {
    std::uint64_t answered = 0, failed = 0;
    std::uint64_t cache_bytes = 0, found = 0, fetched = 0;
  };
  void set_blobs(const BlobFigures& figures);
  /// When the certificate in use ends [s since 1970, UTC].
  void set_certificate_end(double unix_s);
  /// Of keys, certificate or configuration, on SIGHUP.
  void reloaded(bool well);

  /// `read` runs before each `text`, to set what is cheaper to look at than to keep.
  void add_reader(std::function<void()> read);

  /// Everything, as `text/plain; version=0.0.4`.
  [[nodiscard]] std::string text() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

/// Every metric that there is, in the order of the answer.
[[nodiscard]] std::span<const MetricInfo> all_metrics();

}  // namespace stillmap::server

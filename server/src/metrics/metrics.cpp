#include "metrics/metrics.hpp"

#include "metrics/metrics_table.hpp"
#include "metrics/process_figures.hpp"

#include <fmt/format.h>
#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <set>
#include <utility>
#include <variant>
#include <vector>

namespace stillmap::server {
namespace {

namespace prom = prometheus;

using AnyFamily = std::variant<prom::Family<prom::Counter>*, prom::Family<prom::Gauge>*,
                               prom::Family<prom::Histogram>*>;

/// From a tile's fraction of a millisecond to an upload's minutes [s].
const prom::Histogram::BucketBoundaries kSeconds = {0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1,
                                                    0.25,  0.5,    1.0,   2.5,  5.0,   10.0, 60.0};
/// Builds take minutes to hours [s].
const prom::Histogram::BucketBoundaries kJobSeconds = {10.0,   60.0,   300.0,   900.0,
                                                       3600.0, 7200.0, 21600.0, 86400.0};

template <typename Kind>
prom::Family<Kind>* add_family(prom::detail::Builder<Kind> builder, const MetricInfo& info,
                               prom::Registry& registry) {
  return &builder.Name(std::string(info.name)).Help(std::string(info.help)).Register(registry);
}

AnyFamily family_of(const MetricInfo& info, prom::Registry& registry) {
  if (info.type == "counter") return add_family(prom::BuildCounter(), info, registry);
  if (info.type == "gauge") return add_family(prom::BuildGauge(), info, registry);
  return add_family(prom::BuildHistogram(), info, registry);
}

prom::Labels labels_of(std::string_view names, std::initializer_list<std::string_view> values) {
  prom::Labels labels;
  for (const std::string_view value : values) {
    const std::size_t comma = names.find(',');
    labels.emplace(names.substr(0, comma), value);
    names = comma == std::string_view::npos ? std::string_view{} : names.substr(comma + 1);
  }
  return labels;
}

/// Methods that are no method of ours would let a client make labels.
std::string_view known_method(std::string_view method) {
  for (const std::string_view known : {"GET", "HEAD", "POST", "PUT", "DELETE", "PATCH"}) {
    if (method == known) return known;
  }
  return "other";
}

}  // namespace

struct Metrics::Parts {
  using Values = std::initializer_list<std::string_view>;

  Parts() {
    for (const MetricInfo& info : kMetricTable) families.push_back(family_of(info, registry));
  }

  template <typename Kind>
  prom::Family<Kind>& family(Metric metric) {
    return *std::get<prom::Family<Kind>*>(families[static_cast<std::size_t>(metric)]);
  }
  prom::Labels labels(Metric metric, Values values) const {
    return labels_of(kMetricTable.at(static_cast<std::size_t>(metric)).labels, values);
  }
  prom::Counter& counter(Metric metric, Values values = {}) {
    return family<prom::Counter>(metric).Add(labels(metric, values));
  }
  prom::Gauge& gauge(Metric metric, Values values = {}) {
    return family<prom::Gauge>(metric).Add(labels(metric, values));
  }
  prom::Histogram& histogram(Metric metric, Values values = {}) {
    return family<prom::Histogram>(metric).Add(
        labels(metric, values), metric == Metric::kJobDuration ? kJobSeconds : kSeconds);
  }
  /// The name of a map as a label: maps come and go, and each name would stay for ever.
  std::string map_label(std::string_view map) {
    constexpr std::size_t kMostNames = 200;
    const std::lock_guard lock(names_mutex);
    if (map_names.size() < kMostNames) map_names.emplace(map);
    return map_names.contains(std::string(map)) ? std::string(map) : "other";
  }
  /// Of a count that is kept elsewhere.
  void raise(prom::Counter& counter, double to) {
    counter.Increment(std::max(0.0, to - counter.Value()));
  }
  void set_process() {
    const ProcessFigures now = process_figures();
    raise(counter(Metric::kProcessCpu), now.cpu_s);
    gauge(Metric::kProcessMemory).Set(now.resident_bytes);
    gauge(Metric::kProcessFiles).Set(now.open_files);
    gauge(Metric::kProcessMaxFiles).Set(now.max_files);
    gauge(Metric::kProcessThreads).Set(now.threads);
    gauge(Metric::kProcessStart).Set(now.start_unix_s);
  }

  prom::Registry registry;
  std::vector<AnyFamily> families;
  std::mutex names_mutex;
  std::set<std::string> map_names;
  std::mutex revisions_mutex;
  /// By label of the map.
  std::map<std::string, std::int64_t> revisions;
  std::mutex rollouts_mutex;
  /// By label of the map.
  std::map<std::string, RolloutFigure> rollouts;
  /// One `text` at a time, and no reader added meanwhile.
  std::mutex readers_mutex;
  std::vector<std::function<void()>> readers;
};

Metrics::Metrics(const std::string& version) : parts_(std::make_unique<Parts>()) {
  parts_->gauge(Metric::kBuildInfo, {version}).Set(1.0);
  // What is counted without labels stands at 0 from the start, so that rates have a beginning.
  for (std::size_t i = 0; i < kMetricTable.size(); ++i) {
    const auto metric = static_cast<Metric>(i);
    const MetricInfo& info = kMetricTable.at(i);
    if (!info.labels.empty() || metric == Metric::kCertificateEnd) continue;
    if (info.type == "counter") parts_->counter(metric);
    if (info.type == "gauge") parts_->gauge(metric);
    if (info.type == "histogram") parts_->histogram(metric);
  }
}
Metrics::~Metrics() = default;

void Metrics::request_begun() { parts_->gauge(Metric::kRequestsInFlight).Increment(); }

void Metrics::request_answered(const AnsweredRequest& request) {
  const std::string_view route = request.route.empty() ? "none" : request.route;
  parts_->gauge(Metric::kRequestsInFlight).Decrement();
  parts_
      ->counter(Metric::kRequests,
                {known_method(request.method), route, fmt::format("{}xx", request.status / 100)})
      .Increment();
  parts_->histogram(Metric::kRequestDuration, {route}).Observe(request.seconds);
  parts_->counter(Metric::kReceivedBytes).Increment(static_cast<double>(request.received_bytes));
  parts_->counter(Metric::kSentBytes).Increment(static_cast<double>(request.sent_bytes));
}

void Metrics::problem(ErrorCode code) {
  parts_->counter(Metric::kProblems, {info_of(code).text}).Increment();
}

void Metrics::connection_opened() {
  parts_->gauge(Metric::kConnections).Increment();
  parts_->counter(Metric::kConnectionsTotal).Increment();
}
void Metrics::connection_closed() { parts_->gauge(Metric::kConnections).Decrement(); }
void Metrics::connection_refused(std::string_view reason) {
  parts_->counter(Metric::kConnectionsRefused, {reason}).Increment();
}
void Metrics::event_stream_opened() { parts_->gauge(Metric::kEventStreams).Increment(); }
void Metrics::event_stream_closed() { parts_->gauge(Metric::kEventStreams).Decrement(); }

void Metrics::aligned(std::string_view map, std::string_view method, std::string_view status,
                      double seconds) {
  parts_->counter(Metric::kAlignments, {parts_->map_label(map), method, status}).Increment();
  parts_->histogram(Metric::kAlignmentDuration, {method}).Observe(seconds);
}
void Metrics::queue_waited(double seconds) {
  parts_->histogram(Metric::kQueueWait).Observe(seconds);
}
void Metrics::scan_superseded() { parts_->counter(Metric::kSuperseded).Increment(); }
void Metrics::sealed_scan(std::string_view result) {
  parts_->counter(Metric::kSealedScans, {result}).Increment();
}
void Metrics::set_map_chosen(std::string_view map, std::string_view by) {
  parts_->counter(Metric::kSetChoices, {parts_->map_label(map), by}).Increment();
}
void Metrics::handed_over(std::string_view map) {
  parts_->counter(Metric::kHandOvers, {parts_->map_label(map)}).Increment();
}
void Metrics::hand_over_refused(std::string_view map) {
  parts_->counter(Metric::kHandOversRefused, {parts_->map_label(map)}).Increment();
}
void Metrics::set_workers(std::size_t busy, std::size_t stuck, std::size_t all) {
  parts_->gauge(Metric::kWorkersStuck).Set(static_cast<double>(stuck));
  parts_->gauge(Metric::kWorkersBusy).Set(static_cast<double>(busy));
  parts_->gauge(Metric::kWorkers).Set(static_cast<double>(all));
}
void Metrics::set_queue(std::size_t waiting, std::size_t places) {
  parts_->gauge(Metric::kQueueLength).Set(static_cast<double>(waiting));
  parts_->gauge(Metric::kQueuePlaces).Set(static_cast<double>(places));
}
void Metrics::set_sessions(std::size_t open) {
  parts_->gauge(Metric::kSessions).Set(static_cast<double>(open));
}

void Metrics::set_maps(std::size_t ready, std::size_t loading, std::size_t failed) {
  parts_->gauge(Metric::kMaps, {"ready"}).Set(static_cast<double>(ready));
  parts_->gauge(Metric::kMaps, {"loading"}).Set(static_cast<double>(loading));
  parts_->gauge(Metric::kMaps, {"failed"}).Set(static_cast<double>(failed));
}
void Metrics::map_loaded(std::string_view map, double seconds) {
  parts_->gauge(Metric::kMapLoadSeconds, {parts_->map_label(map)}).Set(seconds);
}
void Metrics::map_load_failed(std::string_view map) {
  parts_->counter(Metric::kMapLoadFailures, {parts_->map_label(map)}).Increment();
}

void Metrics::set_map_revisions(const std::map<std::string, std::int64_t>& revisions) {
  const std::lock_guard lock(parts_->revisions_mutex);
  for (auto& [label, revision] : parts_->revisions) revision = 0;
  for (const auto& [map, revision] : revisions)
    parts_->revisions[parts_->map_label(map)] = revision;
  for (const auto& [label, revision] : parts_->revisions)
    parts_->gauge(Metric::kMapRevision, {label}).Set(static_cast<double>(revision));
}

void Metrics::set_rollouts(const std::vector<RolloutFigure>& rollouts) {
  const std::lock_guard lock(parts_->rollouts_mutex);
  for (auto& [label, figure] : parts_->rollouts) figure = {};
  for (const RolloutFigure& each : rollouts) {
    RolloutFigure& figure = parts_->rollouts[parts_->map_label(each.map)];
    figure.share = std::max(figure.share, each.share);
    figure.halted = figure.halted || each.halted;
  }
  for (const auto& [label, figure] : parts_->rollouts) {
    parts_->gauge(Metric::kRolloutShare, {label}).Set(figure.share);
    parts_->gauge(Metric::kRolloutHalted, {label}).Set(figure.halted ? 1.0 : 0.0);
  }
}
void Metrics::rollout_answered(std::string_view map, std::string_view group,
                               std::string_view status) {
  parts_->counter(Metric::kRolloutAnswers, {parts_->map_label(map), group, status}).Increment();
}

void Metrics::set_jobs(std::string_view status, std::size_t count) {
  parts_->gauge(Metric::kJobs, {status}).Set(static_cast<double>(count));
}
void Metrics::job_ended(std::string_view status, double seconds) {
  parts_->counter(Metric::kJobsEnded, {status}).Increment();
  parts_->histogram(Metric::kJobDuration).Observe(seconds);
}

void Metrics::set_store_bytes(std::uint64_t used_bytes) {
  parts_->gauge(Metric::kStoreBytes).Set(static_cast<double>(used_bytes));
}
void Metrics::set_store_disk(std::uint64_t free_bytes, std::uint64_t reserve_bytes, bool writable) {
  parts_->gauge(Metric::kStoreFreeBytes).Set(static_cast<double>(free_bytes));
  parts_->gauge(Metric::kStoreReserveBytes).Set(static_cast<double>(reserve_bytes));
  parts_->gauge(Metric::kStoreWritable).Set(writable ? 1.0 : 0.0);
}
void Metrics::set_state_silence(double seconds) {
  parts_->gauge(Metric::kStateSilence).Set(seconds);
}
void Metrics::audit_missed() { parts_->counter(Metric::kAuditMissing).Increment(); }
void Metrics::set_blobs(const BlobFigures& figures) {
  const auto raise = [&](Metric metric, std::string_view result, std::uint64_t to) {
    parts_->raise(parts_->counter(metric, {result}), static_cast<double>(to));
  };
  raise(Metric::kS3Requests, "answered", figures.answered);
  raise(Metric::kS3Requests, "failed", figures.failed);
  raise(Metric::kCacheFiles, "found", figures.found);
  raise(Metric::kCacheFiles, "fetched", figures.fetched);
  parts_->gauge(Metric::kCacheBytes).Set(static_cast<double>(figures.cache_bytes));
}
void Metrics::set_certificate_end(double unix_s) {
  parts_->gauge(Metric::kCertificateEnd).Set(unix_s);
}
void Metrics::reloaded(bool well) {
  parts_->counter(Metric::kReloads, {well ? "ok" : "failed"}).Increment();
}

void Metrics::add_reader(std::function<void()> read) {
  const std::lock_guard lock(parts_->readers_mutex);
  parts_->readers.push_back(std::move(read));
}

std::string Metrics::text() const {
  const std::lock_guard lock(parts_->readers_mutex);
  for (const std::function<void()>& read : parts_->readers) read();
  parts_->set_process();
  return prom::TextSerializer().Serialize(parts_->registry.Collect());
}

std::span<const MetricInfo> all_metrics() { return kMetricTable; }

}  // namespace stillmap::server

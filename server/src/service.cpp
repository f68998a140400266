#include "service.hpp"
#include "store/free_bytes.hpp"

#include "blobs/s3_client.hpp"
#include "errors/api_error.hpp"
#include "errors/refusal_codes.hpp"
#include "http/header_text.hpp"
#include "security/map_limits.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <stillmap/maps/error.hpp>
#include "store/disk_full.hpp"
#include "store/postgres_database.hpp"
#include "store/store_refusal.hpp"

#include <algorithm>
#include <exception>
#include <span>
#include <stdexcept>
#include <thread>
#include <utility>

namespace stillmap::server {
namespace {

/// Events for as long as the key that asked for them is good: a stream may outlive its key by days.
class GuardedEvents final : public EventSource {
 public:
  /// @param gatekeeper  outlives this.
  GuardedEvents(std::shared_ptr<EventSource> events, Gatekeeper& gatekeeper,
                std::string authorization, Access access)
      : events_(std::move(events)),
        gatekeeper_(gatekeeper),
        authorization_(std::move(authorization)),
        access_(access) {}

  /// Ends without a word: whoever asks again is told why.
  std::optional<std::string> next(std::chrono::milliseconds most) override {
    if (!gatekeeper_.still_admits(authorization_, access_)) return std::nullopt;
    return events_->next(most);
  }

 private:
  std::shared_ptr<EventSource> events_;
  Gatekeeper& gatekeeper_;
  std::string authorization_;
  Access access_;
};

ServerOptions checked(const ServerOptions& options) {
  const std::vector<std::string> broken = options.violations();
  if (!broken.empty()) throw std::invalid_argument(fmt::format("{}", fmt::join(broken, "; ")));
  return options;
}

/// So much is kept free of a disk of this size unless told otherwise.
std::uint64_t usual_disk_reserve(std::uint64_t disk_bytes) {
  constexpr std::uint64_t kLeast = std::uint64_t{256} << 20U;
  return std::min(disk_bytes / 10, std::max(kLeast, disk_bytes / 50));
}

/// @param store  its folder.
StoreQuota quota_of(const QuotaOptions& options, const std::filesystem::path& store) {
  StoreQuota quota;
  if (options.map_bytes > 0) quota.map_bytes = static_cast<std::uint64_t>(options.map_bytes);
  if (options.store_bytes > 0) quota.store_bytes = static_cast<std::uint64_t>(options.store_bytes);
  std::error_code error;
  const std::filesystem::space_info disk = std::filesystem::space(store, error);
  if (options.disk_reserve_bytes > 0)
    quota.disk_reserve = static_cast<std::uint64_t>(options.disk_reserve_bytes);
  else if (options.disk_reserve_bytes < 0 && !error)
    quota.disk_reserve = usual_disk_reserve(disk.capacity);
  return quota;
}

/// @throws maps::InputError for a file that cannot be used.
std::optional<PublicKeys> trust_of(const ServerOptions& options) {
  if (options.trusted_keys_file.empty()) return std::nullopt;
  return read_public_keys(options.trusted_keys_file);
}

/// Before anything is served from it.
PackageStore& trusting(PackageStore& store, const ServerOptions& options) {
  store.set_trust(trust_of(options));
  return store;
}

/// What is derived comes after what is uploaded, so it leaves the reserve too.
std::uint64_t left_by_views(const ServerOptions& options, const std::filesystem::path& store) {
  return std::max(MapViews::kLeftFree, quota_of(options.quotas, store).disk_reserve.value_or(0));
}

int worker_count(const ServerOptions& options) {
  if (options.workers > 0) return options.workers;
  return static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
}

QueueLimits queue_limits(const ServerOptions& options, int workers) {
  return {.workers = workers,
          .waiting = options.queue,
          .requests = options.max_requests,
          .body_bytes = options.max_bodies_bytes,
          .client_share = options.client_share};
}

/// A version that is made ready for poses will be looked at too.
AlignerBuilder warming(AlignerBuilder builder, MapViews& views) {
  return [builder = std::move(builder), &views](
             const maps::MapPackage& map, const localization::LocalizationOptions& localization) {
    Aligners aligners = builder(map, localization);
    views.warm(map);
    return aligners;
  };
}

/// The page speaks to this server alone, and no file is run as something else than it says.
void add_page_headers(HttpResponse& response) {
  response.headers.emplace_back("Content-Security-Policy", "default-src 'self'");
  response.headers.emplace_back("Referrer-Policy", "no-referrer");
}

/// Bytes that several answers share.
class SharedBytes final : public BodySource {
 public:
  explicit SharedBytes(std::shared_ptr<const std::string> bytes) : bytes_(std::move(bytes)) {}
  [[nodiscard]] std::uint64_t size() const override { return bytes_->size(); }
  void read(std::uint64_t offset, std::span<char> to) override {
    bytes_->copy(to.data(), to.size(), offset);
  }

 private:
  std::shared_ptr<const std::string> bytes_;
};

HttpResponse asset_response(const WebAsset& asset, const HttpRequest& request) {
  HttpResponse response{.content_type = asset.content_type, .body = {}, .headers = {}};
  const bool packed = asset.packed && takes_gzip(request.header("accept-encoding"));
  response.source = std::make_shared<SharedBytes>(packed ? asset.packed : asset.body);
  if (asset.packed) response.headers.emplace_back("Vary", "Accept-Encoding");
  if (packed) response.headers.emplace_back("Content-Encoding", "gzip");
  response.headers.emplace_back("Cache-Control",
                                asset.hashed ? "public, max-age=31536000, immutable" : "no-cache");
  add_page_headers(response);
  return response;
}

HttpResponse no_page(const HttpRequest&, const PathParameters&) {
  HttpResponse response{
      .content_type = "text/html; charset=utf-8",
      .body =
          "<!doctype html><title>stillmap</title><p>The server runs, but the web page was "
          "not built. The maps are listed at <a href=\"/v1/maps\">/v1/maps</a>.\n",
      .headers = {}};
  add_page_headers(response);
  return response;
}

std::vector<Route> all_routes(const Context& context, const std::vector<WebAsset>& web) {
  std::vector<Route> routes;
  add_health_routes(routes, context);
  add_map_routes(routes, context);
  add_map_change_routes(routes, context);
  add_version_routes(routes, context);
  add_package_routes(routes, context);
  add_signature_routes(routes, context);
  add_upload_routes(routes, context);
  add_drive_routes(routes, context);
  add_edit_routes(routes, context);
  add_rebuild_routes(routes, context);
  add_job_routes(routes, context);
  add_audit_routes(routes, context);
  add_key_routes(routes, context);
  add_layer_routes(routes, context);
  add_tile_routes(routes, context);
  add_tileset_routes(routes, context);
  add_difference_routes(routes, context);
  add_localize_routes(routes, context);
  add_batch_routes(routes, context);
  add_session_routes(routes, context);
  add_sealed_session_routes(routes, context);
  add_set_routes(routes, context);
  add_stats_routes(routes, context);
  add_rollout_routes(routes, context);
  add_openapi_routes(routes);
  for (const WebAsset& asset : web) {
    // In a pattern a brace would stand for any name.
    if (asset.path.find('{') != std::string::npos) continue;
    routes.push_back({"GET", asset.path,
                      [asset](const HttpRequest& request, const PathParameters&) {
                        return asset_response(asset, request);
                      },
                      Access::kOpen});
  }
  const auto is_page = [](const WebAsset& asset) { return asset.path == "/"; };
  if (std::none_of(web.begin(), web.end(), is_page))
    routes.push_back({"GET", "/", no_page, Access::kOpen});
  return routes;
}

void set_map_figures(Metrics& metrics, const MapCatalog& catalog) {
  std::size_t ready = 0;
  std::size_t failed = 0;
  const std::vector<ServedVersion> maps = catalog.active();
  std::map<std::string, std::int64_t> revisions;
  for (const ServedVersion& map : maps) {
    revisions[map.map] = map.revision;
    ready += map.state == MapState::kReady ? 1 : 0;
    failed += map.state == MapState::kFailed ? 1 : 0;
  }
  metrics.set_maps(ready, maps.size() - ready - failed, failed);
  metrics.set_map_revisions(revisions);
}

void set_rollout_figures(Metrics& metrics, const MapCatalog& catalog) {
  std::vector<Metrics::RolloutFigure> figures;
  for (const Rollout& each : catalog.rollouts())
    figures.push_back(
        {.map = each.map, .share = each.halted ? 0.0 : each.share, .halted = each.halted});
  metrics.set_rollouts(figures);
}

void set_store_figures(Metrics& metrics, const PackageStore& store) {
  metrics.set_store_disk(free_bytes(store.folder()), store.quota().disk_reserve.value_or(0),
                         store.state().not_writable_because().empty());
  metrics.set_state_silence(store.state().silence().count());
  if (const PackageBlobs* blobs = store.blobs()) {
    const PackageBlobs::Figures figures = blobs->figures();
    metrics.set_blobs({.answered = figures.answered,
                       .failed = figures.failed,
                       .cache_bytes = figures.local_bytes,
                       .found = figures.found,
                       .fetched = figures.fetched});
  }
  try {
    const JobTable& jobs = store.state().jobs();
    for (const JobStatus status : {JobStatus::kEnqueued, JobStatus::kProcessing})
      metrics.set_jobs(name_of(status), jobs.count(status));
    metrics.set_store_bytes(store.state().bytes());
  } catch (const maps::StorageError& error) {
    // The other figures are there all the same; the last ones of the store stay.
    spdlog::error("figures of the store: {}", error.what());
  }
}

/// What a request was about, as "town/v2".
std::string subject_of(const Router::Match& match) {
  std::string subject;
  const std::string& pattern = match.route->pattern;
  for (std::size_t begin = pattern.find('{'); begin != std::string::npos;
       begin = pattern.find('{', begin + 1)) {
    const std::string name = pattern.substr(begin + 1, pattern.find('}', begin) - begin - 1);
    subject += (subject.empty() ? "" : "/") + match.parameters.at(name);
  }
  // Of a name that no map can have: the audit log stays text that any JSON holds as it is.
  std::replace_if(
      subject.begin(), subject.end(), [](char byte) { return byte < ' ' || byte > '~'; }, '?');
  return subject;
}

/// Whether the audit log tells of it.
bool is_write(const Route& route) {
  const bool changes = route.access == Access::kWrite || route.access == Access::kAdmin;
  return changes && route.method != "GET";
}

/// The exception that is being handled, as the client is told of it. Paths of this machine stay in
/// the log; that of the request does not get there, since the name of a session is its secret.
ApiError caught(const HttpRequest& request, const Route& route) {
  const auto logged = [&](ErrorCode code, const std::exception& error) {
    spdlog::error("{} {} {}: {}", request.request_id, route.method, route.pattern, error.what());
    if (code == ErrorCode::kDiskFull) return ApiError(code, "there is no room left for it");
    if (code == ErrorCode::kStateAway)
      return ApiError(code, is_write(route)
                                ? "it may have happened: send it again after Retry-After"
                                : "PostgreSQL does not answer: ask again after Retry-After");
    if (code == ErrorCode::kPackagesAway)
      return ApiError(code, "S3 does not answer: send it again after Retry-After");
    return ApiError(code, "the log says more");
  };
  try {
    throw;
  } catch (const ApiError& error) {
    return error;
  } catch (const StoreRefusal& error) {
    return {code_of(error.reason()), error.what()};
  } catch (const StateAway& error) {
    return logged(ErrorCode::kStateAway, error).with_header("Retry-After", "1");
  } catch (const S3Error& error) {
    if (!error.may_pass()) return logged(ErrorCode::kStorageError, error);
    return logged(ErrorCode::kPackagesAway, error).with_header("Retry-After", "5");
  } catch (const DiskFull& error) {
    return logged(ErrorCode::kDiskFull, error);
  } catch (const maps::StorageError& error) {
    return logged(ErrorCode::kStorageError, error);
  } catch (const maps::InputError& error) {
    return logged(ErrorCode::kStorageError, error);
  } catch (const std::filesystem::filesystem_error& error) {
    return logged(is_disk_full(error) ? ErrorCode::kDiskFull : ErrorCode::kStorageError, error);
  } catch (const std::exception& error) {
    return logged(ErrorCode::kInternalError, error);
  }
}

/// Whether it is for making room, or for ending what somebody does: possible on a full disk too.
bool removes(const Route& route) {
  return route.method == "DELETE" || route.pattern.ends_with("/cancel");
}

}  // namespace

Service::Service(const ServerOptions& options, PackageStore& store, AlignerBuilder builder,
                 const std::vector<WebAsset>& web, const std::filesystem::path& mapper,
                 StoreChanges changes)
    : options_(checked(options)),
      live_(options_),
      store_(trusting(store, options_)),
      changes_(changes),
      metrics_(STILLMAP_VERSION),
      gatekeeper_(store.keys(), is_loopback(options_.host)),
      views_(store.packages().path().parent_path(),
             left_by_views(options_, store.packages().path().parent_path())),
      layers_(store.packages().path().parent_path()),
      catalog_(store, warming(std::move(builder), views_), &metrics_,
               options_.localization_options_dir),
      drives_(store),
      workers_(worker_count(options_)),
      queue_(queue_limits(options_, workers_)),
      sessions_({.most = options_.sessions.max,
                 .idle = std::chrono::seconds(options_.sessions.idle_expiry_s),
                 .client_share = options_.client_share},
                queue_),
      seals_(seal_keys_of(store)),
      jobs_(JobSetup{live_, store, drives_, catalog_, metrics_, mapper}),
      context_{options_,
               live_,
               workers_,
               store,
               drives_,
               uploads_,
               catalog_,
               views_,
               layers_,
               queue_,
               sessions_,
               seals_,
               jobs_,
               metrics_,
               stats_,
               vehicles_,
               rollout_counts_,
               stopping_,
               std::chrono::steady_clock::now()},
      router_(all_routes(context_, web)),
      housekeeping_(live_, store, drives_, jobs_.folders, changes != StoreChanges::kRefused) {
  store_.set_quota(quota_of(options_.quotas, store_.folder()));
  add_metrics();
}

void Service::add_metrics() {
  metrics_.add_reader([this] {
    const AlignmentQueue::Figures figures = queue_.figures();
    metrics_.set_workers(static_cast<std::size_t>(figures.running),
                         static_cast<std::size_t>(figures.stuck),
                         static_cast<std::size_t>(workers_));
    metrics_.set_queue(static_cast<std::size_t>(figures.waiting),
                       static_cast<std::size_t>(options_.queue));
    metrics_.set_sessions(sessions_.size());
    set_map_figures(metrics_, catalog_);
    set_rollout_figures(metrics_, catalog_);
    set_store_figures(metrics_, context_.store);
  });
}

std::function<void()> Service::prepare_trust(const ServerOptions& next) {
  return [this, keys = trust_of(next)] {
    store_.set_trust(keys);
    catalog_.refresh();
  };
}

void Service::reload(const ServerOptions& options) {
  live_.replace(options);
  store_.set_quota(quota_of(options.quotas, store_.folder()));
}

Router::Match Service::find(const HttpRequest& request) const {
  return router_.match(request.method, request.path);
}

Router::Match Service::admit(HttpRequest& request) const {
  Router::Match match = find(request);
  admit(request, match);
  return match;
}

void Service::admit(HttpRequest& request, const Router::Match& match) const {
  try {
    gatekeeper_.admit(request, match.route->access, live_.current()->rate);
    require_maps_of_path(request, match, store_);
    if (changes_ == StoreChanges::kRefused && is_write(*match.route))
      throw ApiError(ErrorCode::kReadOnly,
                     "it serves one map from its folder; to publish, rebuild or make keys, start "
                     "it with a store: stillmap serve --store DIR");
    if (match.route->reserve) request.reservation = match.route->reserve(request, match.parameters);
  } catch (const std::exception&) {
    const ApiError error = caught(request, *match.route);
    note_refused(request, match, error);
    throw ApiError(error);
  }
}

HttpResponse Service::handle(HttpRequest request) const {
  try {
    const Router::Match match = admit(request);
    return handle(request, match);
  } catch (const ApiError& error) {
    return problem_response(error, request.request_id);
  }
}

HttpResponse Service::handle(const HttpRequest& request, const Router::Match& match) const {
  HttpResponse response = answer(request, match);
  if (is_write(*match.route)) note_write(request, match, response.status);
  if (response.events) {
    response.events =
        std::make_shared<GuardedEvents>(std::move(response.events), gatekeeper_,
                                        request.header("authorization"), match.route->access);
  }
  return response;
}

/// Without a right to it. Whoever has none must not fill the disk, nor make it sync all day.
void Service::note_refused(const HttpRequest& request, const Router::Match& match,
                           const ApiError& error) const {
  constexpr RateOptions kRows{.requests_per_s = 1.0, .burst = 60};
  const int status = info_of(error.code()).http_status;
  if (!is_write(*match.route) || (status != 401 && status != 403)) return;
  if (refused_rows_.take({}, kRows) == 0.0) note_write(request, match, status);
}

void Service::note_write(const HttpRequest& request, const Router::Match& match, int status) const {
  try {
    const auto append = [&] {
      context_.store.audit().append({.time_ns = unix_ns(),
                                     .request_id = request.request_id,
                                     .server_request_id = request.server_request_id,
                                     .source = request.remote_address,
                                     .key_id = request.caller.key_id,
                                     .method = request.method,
                                     .route = match.route->pattern,
                                     .subject = subject_of(match),
                                     .status = status});
    };
    if (status < 300 && removes(*match.route))
      context_.store.even_when_full(append);
    else
      append();
  } catch (const std::exception& error) {
    // What was done is done, and its answer is true.
    metrics_.audit_missed();
    spdlog::error("{} is not in the audit log: {}", request.request_id, error.what());
  }
}

HttpResponse Service::answer(const HttpRequest& request, const Router::Match& match) const {
  try {
    return match.route->handler(request, match.parameters);
  } catch (const std::exception&) {
    const ApiError error = caught(request, *match.route);
    metrics_.problem(error.code());
    return problem_response(error, request.request_id);
  }
}

}  // namespace stillmap::server

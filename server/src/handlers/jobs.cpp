#include "bodies/jobs_json.hpp"
#include "context.hpp"
#include "errors/api_error.hpp"
#include "page_query.hpp"
#include "security/map_limits.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include "store/store_refusal.hpp"

#include <algorithm>
#include <cerrno>
#include <stdexcept>
#include <utility>

namespace stillmap::server {
namespace {

/// What happens to one job on its way to one client.
class JobStream final : public EventSource {
 public:
  JobStream(LiveJobs& jobs, std::int64_t id, std::uint64_t last_id)
      : jobs_(jobs), id_(id), last_id_(last_id), events_(jobs.events(id)) {}

  std::optional<std::string> next(std::chrono::milliseconds most) override {
    if (ended_) return std::nullopt;
    if (events_ == nullptr) return last_of_finished();
    SessionEvents::Read read = events_->after(last_id_, most);
    if (!read.events.empty()) last_id_ = read.events.back().id;
    ended_ = read.closed;
    // One that another process has cancelled, or that the store has forgotten, has no last event.
    if (read.events.empty() && !ended_) return if_ended_elsewhere();
    return to_stream(read);
  }

 private:
  std::optional<std::string> last_of_finished() {
    ended_ = true;
    const JobView view = jobs_.view(id_);
    const std::uint64_t id = event_id_at(*view.job.finished_ns);
    if (last_id_ >= id) return std::nullopt;
    return to_stream({.events = {{id, "end", job_event_json(view)}}, .closed = true});
  }

  std::optional<std::string> if_ended_elsewhere() {
    try {
      const JobView view = jobs_.view(id_);
      if (!is_finished(view.job.status)) return if_changed_elsewhere(view);
      // Unless its last event came in between.
      SessionEvents::Read read = events_->after(last_id_, std::chrono::milliseconds(0));
      if (read.events.empty()) return last_of_finished();
      ended_ = read.closed;
      last_id_ = read.events.back().id;
      return to_stream(read);
    } catch (const StoreRefusal&) {
      ended_ = true;
      return std::nullopt;
    }
  }

  /// Of a job that another server works on, or will: no events are made here. Their ids do not
  /// grow, since the last one has the time of that server's clock.
  std::string if_changed_elsewhere(const JobView& view) {
    std::string now = job_event_json(view);
    if (view.is_here || now == elsewhere_) return {};
    elsewhere_ = std::move(now);
    last_id_ = std::max(last_id_, event_id_at(view.job.enqueued_ns));
    return to_stream({.events = {{last_id_, "progress", elsewhere_}}, .closed = false});
  }

  LiveJobs& jobs_;
  std::int64_t id_;
  std::uint64_t last_id_;
  /// What was said last of a job that another server works on.
  std::string elsewhere_;
  std::shared_ptr<JobEvents> events_;
  bool ended_ = false;
};

/// A log as it is when it is asked for; what is added while it travels stays out.
class LogSource final : public BodySource {
 public:
  explicit LogSource(const std::filesystem::path& file)
      : file_(::open(file.c_str(), O_RDONLY | O_CLOEXEC)) {
    struct stat found {};
    if (file_.is_open() && ::fstat(file_.get(), &found) == 0)
      size_ = static_cast<std::uint64_t>(found.st_size);
  }
  [[nodiscard]] std::uint64_t size() const override { return size_; }
  void read(std::uint64_t offset, std::span<char> to) override {
    for (std::size_t done = 0; done < to.size();) {
      const ssize_t got = ::pread(file_.get(), to.data() + done, to.size() - done,
                                  static_cast<off_t>(offset + done));
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) throw std::runtime_error("the log is shorter than it was");
      done += static_cast<std::size_t>(got);
    }
  }

 private:
  Descriptor file_;
  std::uint64_t size_ = 0;
};

std::int64_t job_id(const PathParameters& path) {
  const std::string& text = path.at("job");
  if (const std::optional<std::int64_t> id = id_in(text)) return *id;
  throw ApiError(ErrorCode::kUnknownJob, fmt::format("there is no job '{}'", text));
}

HttpResponse list_jobs(const Context& context, const HttpRequest& request) {
  const auto values = read_query(request, {"status", "map", "limit", "before"});
  const PageQuery page = read_page(values);
  JobTable::Filter filter;
  if (const auto map = values.find("map"); map != values.end()) {
    require_map(request.caller, map->second);
    static_cast<void>(context.store.state().map(map->second));
    filter.map = map->second;
  }
  filter.maps = request.caller.maps;
  if (const auto status = values.find("status"); status != values.end()) {
    filter.status = job_status_of(status->second);
    if (!filter.status)
      throw field_error(ErrorCode::kInvalidRequest, "status", "'" + status->second + "'",
                        "enqueued, processing, succeeded, failed or canceled");
  }
  const JobTable::Page found = context.store.jobs().list(filter, page.limit, page.before);
  std::vector<JobView> views;
  for (const StoredJob& job : found.jobs) views.push_back(context.jobs.live.view(job));
  return json_response(job_list_json(views, found.next));
}

HttpResponse cancel_job(const Context& context, const PathParameters& path) {
  const StoredJob job = context.jobs.live.cancel(job_id(path));
  // What is processing ends within two seconds.
  return json_response(job_json(context.jobs.live.view(job.id)),
                       is_finished(job.status) ? 200 : 202);
}

HttpResponse stream_job(const Context& context, const HttpRequest& request,
                        const PathParameters& path) {
  const std::int64_t id = job_id(path);
  const StoredJob job = context.store.jobs().job(id);
  const std::uint64_t last_id = last_event_id(request.header("last-event-id"));
  // Told so, a browser stops asking for more.
  if (is_finished(job.status) && last_id >= event_id_at(*job.finished_ns))
    return {.status = 204, .content_type = {}, .body = {}, .headers = {}};
  HttpResponse response;
  response.events = std::make_shared<JobStream>(context.jobs.live, id, last_id);
  return response;
}

HttpResponse job_log(const Context& context, const PathParameters& path) {
  const std::int64_t id = job_id(path);
  const StoredJob job = context.store.jobs().job(id);
  if (!context.jobs.folders.has_files_of(job.server))
    throw ApiError(ErrorCode::kOtherServer,
                   fmt::format("the log of job {} is in the folder of server {}: ask that one", id,
                               job.server));
  HttpResponse response{.content_type = "text/plain; charset=utf-8", .body = {}, .headers = {}};
  response.headers.emplace_back("Cache-Control", "no-cache");
  auto log = std::make_shared<LogSource>(context.jobs.folders.of(id).log());
  // Of a job that has said nothing yet.
  if (log->size() > 0) response.source = std::move(log);
  return response;
}

}  // namespace

void add_job_routes(std::vector<Route>& routes, const Context& context) {
  routes.push_back(
      {.method = "GET",
       .pattern = "/v1/jobs",
       .handler = [&context](const HttpRequest& request,
                             const PathParameters&) { return list_jobs(context, request); },
       .limits_maps = true});
  routes.push_back(
      {"GET", "/v1/jobs/{job}", [&context](const HttpRequest&, const PathParameters& path) {
         return json_response(job_json(context.jobs.live.view(job_id(path))));
       }});
  routes.push_back({"POST", "/v1/jobs/{job}/cancel",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return cancel_job(context, path);
                    },
                    Access::kWrite});
  routes.push_back({"GET", "/v1/jobs/{job}/events",
                    [&context](const HttpRequest& request, const PathParameters& path) {
                      return stream_job(context, request, path);
                    }});
  // It names files of the machine: for those who may change maps.
  routes.push_back({"GET", "/v1/jobs/{job}/log",
                    [&context](const HttpRequest&, const PathParameters& path) {
                      return job_log(context, path);
                    },
                    Access::kWrite});
}

}  // namespace stillmap::server

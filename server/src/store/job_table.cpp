#include "store/job_table.hpp"

#include <array>
#include <stdexcept>
#include <utility>

#include <stillmap/maps/sha256.hpp>
#include "store/map_rows.hpp"
#include "store/store_database.hpp"

namespace stillmap::server {
namespace {

using Reading = StoreDatabase::Reading;
using Reason = StoreRefusal::Reason;
using Writing = StoreDatabase::Writing;

constexpr std::array<std::pair<JobStatus, std::string_view>, 5> kStatusNames = {{
    {JobStatus::kEnqueued, "enqueued"},
    {JobStatus::kProcessing, "processing"},
    {JobStatus::kSucceeded, "succeeded"},
    {JobStatus::kFailed, "failed"},
    {JobStatus::kCanceled, "canceled"},
}};
constexpr std::size_t kLargestJobPage = 1000;
/// Of the requests and outcomes on a page: they may hold the corrections of a whole map.
constexpr std::size_t kMostPageBytes = std::size_t{4} << 20U;
constexpr const char* kSelectJobs =
    "SELECT id, kind, map, request, status, stage, error, result_version, attempts, enqueued_ns,"
    " started_ns, finished_ns, asker, idempotency_key, cancel_requested, server,"
    " files_at, fraction, eta_s, outcome, crashes FROM jobs ";

constexpr const char* kSelectBeats =
    "SELECT id, attempts, beat FROM jobs WHERE status = 'processing'";
/// The last beat of an attempt whose server ends in order.
constexpr std::int64_t kExcused = -1;

std::vector<JobTable::Beat> beats_of(Statement& row) {
  std::vector<JobTable::Beat> beats;
  while (row.step())
    beats.push_back({StoredJob{.id = row.integer(0), .attempts = row.integer(1)}, row.integer(2)});
  return beats;
}

JobTable::Crashed crashed_by(const JobTable::Beat& last) {
  return last.beats == kExcused ? JobTable::Crashed::kNo : JobTable::Crashed::kYes;
}

StoredJob job_of(const Statement& row) {
  StoredJob job{.id = row.integer(0), .map = row.text(2), .request = row.text(3)};
  job.kind = row.text(1) == name_of(JobKind::kConvert) ? JobKind::kConvert : JobKind::kRebuild;
  job.status = job_status_of(row.text(4)).value();
  job.stage = row.text(5);
  job.error = row.text(6);
  job.result_version = row.optional_text(7);
  job.attempts = row.integer(8);
  job.enqueued_ns = row.integer(9);
  job.started_ns = row.optional_integer(10);
  job.finished_ns = row.optional_integer(11);
  job.asker = row.text(12);
  job.idempotency_key = row.optional_text(13);
  job.cancel_requested = row.integer(14) != 0;
  job.server = row.text(15);
  job.files_at = row.text(16);
  job.advance.fraction = row.real(17);
  if (row.real(18) >= 0.0) job.advance.eta_s = row.real(18);
  job.outcome = row.text(19);
  job.crashes = row.integer(20);
  return job;
}

StoredJob known_job(Database& database, std::int64_t id) {
  Statement row(database, std::string(kSelectJobs) + "WHERE id = ?");
  if (!row.bind(id).step())
    throw StoreRefusal(Reason::kUnknownJob, "there is no job " + std::to_string(id));
  return job_of(row);
}

/// @throws StoreRefusal kNotProcessing also when another attempt has begun.
StoredJob processing_job(Database& database, const JobClaim& claim) {
  StoredJob job = known_job(database, claim.id);
  if (job.status != JobStatus::kProcessing)
    throw StoreRefusal(Reason::kNotProcessing, "job " + std::to_string(claim.id) + " is " +
                                                   std::string(name_of(job.status)));
  if (job.attempts != claim.attempt)
    throw StoreRefusal(Reason::kNotProcessing, "attempt " + std::to_string(claim.attempt) +
                                                   " at job " + std::to_string(claim.id) +
                                                   " was given up, and another one has begun");
  return job;
}

/// Writes what can change of a job.
void update(Database& database, const StoredJob& job) {
  Statement(database,
            "UPDATE jobs SET status = ?, stage = ?, error = ?, result_version = ?,"
            " attempts = ?, started_ns = ?, finished_ns = ?, cancel_requested = ?, outcome = ?,"
            " crashes = ? WHERE id = ?")
      .bind(name_of(job.status))
      .bind(job.stage)
      .bind(job.error)
      .bind(job.result_version)
      .bind(job.attempts)
      .bind(job.started_ns)
      .bind(job.finished_ns)
      .bind(std::int64_t{job.cancel_requested})
      .bind(job.outcome)
      .bind(job.crashes)
      .bind(job.id)
      .step();
}

void end(StoredJob& job, JobStatus status, std::int64_t now_ns) {
  job.status = status;
  job.finished_ns = now_ns;
  job.cancel_requested = false;
}

void put_back_or_cancel(StoredJob& job, std::string_view error, std::int64_t now_ns,
                        JobTable::Crashed crashed) {
  job.error = error;
  if (crashed == JobTable::Crashed::kYes) ++job.crashes;
  if (job.cancel_requested) return end(job, JobStatus::kCanceled, now_ns);
  job.status = JobStatus::kEnqueued;
}

/// Of all that makes two requests the same. Lengths keep their parts apart.
std::string sha256_of_request(const NewJob& job) {
  maps::Sha256 hash;
  const std::string& asked = job.asked.empty() ? job.request : job.asked;
  for (const std::string& part : {std::string(name_of(job.kind)), job.map, asked}) {
    const std::string piece = std::to_string(part.size()) + ":" + part;
    hash.add(piece.data(), piece.size());
  }
  for (const std::int64_t drive : job.drives) {
    const std::string piece = "," + std::to_string(drive);
    hash.add(piece.data(), piece.size());
  }
  return hash.hex();
}

std::optional<StoredJob> asked_before(Database& database, const NewJob& job,
                                      const std::string& sha256) {
  if (!job.idempotency_key) return std::nullopt;
  Statement row(database,
                "SELECT id, request_sha256 FROM jobs WHERE asker = ? AND idempotency_key = ?");
  if (!row.bind(job.asker).bind(*job.idempotency_key).step()) return std::nullopt;
  if (row.text(1) != sha256)
    throw StoreRefusal(Reason::kOtherRequest, "the idempotency key was used for job " +
                                                  row.text(0) + ", which is something else");
  return known_job(database, row.integer(0));
}

/// @return the server in whose folder it is.
std::string check_drive(Database& database, std::string_view map, std::int64_t drive) {
  Statement row(database,
                "SELECT status, files_at FROM drives WHERE id = ? AND map = ? AND version IS NULL");
  if (!row.bind(drive).bind(map).step())
    throw StoreRefusal(Reason::kUnknownDrive,
                       "map " + in_quotes(map) + " has no drive " + std::to_string(drive));
  if (row.text(0) != "complete")
    throw StoreRefusal(Reason::kDriveNotComplete,
                       "drive " + std::to_string(drive) + " is " + row.text(0) + ", not complete");
  return row.text(1);
}

/// Of all that the job reads; empty where no server is known to have it.
std::string files_of(Database& database, const NewJob& job) {
  std::string files_at = job.files_at;
  for (const std::int64_t drive : job.drives) {
    const std::string at = check_drive(database, job.map, drive);
    if (!at.empty() && !files_at.empty() && at != files_at) {
      std::string message = "drive " + std::to_string(drive);
      message.append(" is in the folder of server ").append(at);
      message.append(", and another drive of the job in that of server ").append(files_at);
      message += ": upload all drives of a rebuild to one server";
      throw StoreRefusal(Reason::kOtherServer, message);
    }
    if (!at.empty()) files_at = at;
  }
  return files_at;
}

std::int64_t insert(Database& database, const NewJob& job, const std::string& files_at,
                    const std::string& sha256, std::int64_t now_ns) {
  Statement row(database,
                "INSERT INTO jobs (kind, map, request, status, enqueued_ns, asker,"
                " idempotency_key, request_sha256, files_at)"
                " VALUES (?, ?, ?, 'enqueued', ?, ?, ?, ?, ?) RETURNING id");
  row.bind(name_of(job.kind))
      .bind(job.map)
      .bind(job.request)
      .bind(now_ns)
      .bind(job.asker)
      .bind(job.idempotency_key)
      .bind(sha256)
      .bind(files_at)
      .step();
  const std::int64_t id = row.integer(0);
  for (const std::int64_t drive : job.drives)
    Statement(database, "INSERT INTO job_drives (job, drive) VALUES (?, ?) ON CONFLICT DO NOTHING")
        .bind(id)
        .bind(drive)
        .step();
  return id;
}

/// A pattern of maps as LIKE reads it. Names of maps have no capital letters, which SQLite's LIKE
/// does not tell apart.
std::string like_of(std::string_view pattern) {
  std::string text;
  for (const char c : pattern) {
    if (c == '_') text += '!';
    text += c == '*' ? '%' : c;
  }
  return text;
}

}  // namespace

std::string_view name_of(JobKind kind) { return kind == JobKind::kConvert ? "convert" : "rebuild"; }

std::string_view name_of(JobStatus status) {
  for (const auto& [value, name] : kStatusNames)
    if (value == status) return name;
  throw std::invalid_argument("not a status of a job");
}

std::optional<JobStatus> job_status_of(std::string_view name) {
  for (const auto& [value, known] : kStatusNames)
    if (known == name) return value;
  return std::nullopt;
}

bool is_finished(JobStatus status) {
  return status != JobStatus::kEnqueued && status != JobStatus::kProcessing;
}

JobTable::Enqueued JobTable::enqueue(const NewJob& job, std::int64_t now_ns) {
  const std::string sha256 = sha256_of_request(job);
  Writing writing(*database_);
  Database& database = writing.database();
  if (std::optional<StoredJob> before = asked_before(database, job, sha256)) {
    // A repeat says no more than what standbys have.
    writing.commit();
    return {*std::move(before), false};
  }
  (void)known_map(database, job.map);
  const std::string files_at = files_of(database, job);
  const std::int64_t id = insert(database, job, files_at, sha256, now_ns);
  Enqueued enqueued{known_job(database, id), true};
  writing.commit();
  return enqueued;
}

std::optional<StoredJob> JobTable::claim(std::int64_t now_ns, std::string_view server,
                                         const std::vector<std::string>& files_at) {
  std::string where = "WHERE status = 'enqueued'";
  for (std::size_t i = 0; i < files_at.size(); ++i)
    where += i == 0 ? " AND files_at IN ('', ?" : ", ?";
  if (!files_at.empty()) where += ")";
  Writing writing(*database_);
  Database& database = writing.database();
  StoredJob job;
  {
    Statement row(database, kSelectJobs + where + " ORDER BY id LIMIT 1");
    for (const std::string& each : files_at) row.bind(each);
    if (!row.step()) return std::nullopt;
    job = job_of(row);
  }
  job.status = JobStatus::kProcessing;
  job.stage.clear();
  ++job.attempts;
  job.started_ns = now_ns;
  job.server = server;
  job.advance = {};
  update(database, job);
  Statement(database, "UPDATE jobs SET server = ?, beat = 0, fraction = 0, eta_s = -1 WHERE id = ?")
      .bind(server)
      .bind(job.id)
      .step();
  writing.commit();
  return job;
}

bool JobTable::beat(const JobClaim& claim, const JobAdvance& advance) {
  Writing writing(*database_);
  Statement(writing.database(),
            "UPDATE jobs SET beat = beat + 1, fraction = ?, eta_s = ? WHERE id = ? AND attempts = ?"
            " AND status = 'processing'")
      .bind_real(advance.fraction)
      .bind_real(advance.eta_s.value_or(-1.0))
      .bind(claim.id)
      .bind(claim.attempt)
      .step();
  const bool is_ours = writing.database().changes() > 0;
  writing.commit();
  return is_ours;
}

std::vector<JobTable::Beat> JobTable::beats() const {
  const Reading reading(*database_);
  Statement row(reading.database(), kSelectBeats);
  return beats_of(row);
}

std::vector<std::int64_t> JobTable::cancel_requests() const {
  const Reading reading(*database_);
  Statement row(reading.database(),
                "SELECT id FROM jobs WHERE status = 'processing' AND cancel_requested <> 0");
  std::vector<std::int64_t> ids;
  while (row.step()) ids.push_back(row.integer(0));
  return ids;
}

bool JobTable::put_back_silent(const Beat& last, std::string_view error, std::int64_t now_ns) {
  Writing writing(*database_);
  Statement row(writing.database(),
                "SELECT 1 FROM jobs WHERE id = ? AND attempts = ? AND beat = ?"
                " AND status = 'processing'");
  if (!row.bind(last.claim.id).bind(last.claim.attempt).bind(last.beats).step()) return false;
  StoredJob job = processing_job(writing.database(), last.claim);
  put_back_or_cancel(job, error, now_ns, crashed_by(last));
  update(writing.database(), job);
  writing.commit();
  return true;
}

void JobTable::set_stage(const JobClaim& claim, std::string_view stage) {
  Writing writing(*database_);
  StoredJob job = processing_job(writing.database(), claim);
  job.stage = stage;
  update(writing.database(), job);
  writing.commit();
}

std::int64_t JobTable::activates_at(const JobClaim& claim, std::int64_t revision) {
  Writing writing(*database_);
  (void)processing_job(writing.database(), claim);
  Statement(writing.database(),
            "UPDATE jobs SET activates_at = coalesce(activates_at, ?) WHERE id = ?")
      .bind(revision)
      .bind(claim.id)
      .step();
  Statement row(writing.database(), "SELECT activates_at FROM jobs WHERE id = ?");
  row.bind(claim.id).step();
  const std::int64_t kept = row.integer(0);
  writing.commit();
  return kept;
}

StoredJob JobTable::succeed(const JobClaim& claim, std::string_view result_version,
                            std::int64_t now_ns, std::string_view outcome) {
  Writing writing(*database_);
  StoredJob job = processing_job(writing.database(), claim);
  end(job, JobStatus::kSucceeded, now_ns);
  job.error.clear();
  job.result_version = result_version;
  job.outcome = outcome;
  update(writing.database(), job);
  writing.commit();
  return job;
}

StoredJob JobTable::fail(const JobClaim& claim, std::string_view error, std::int64_t now_ns) {
  return database_->even_when_full([&] {
    Writing writing(*database_);
    StoredJob job = processing_job(writing.database(), claim);
    end(job, JobStatus::kFailed, now_ns);
    job.error = error;
    update(writing.database(), job);
    writing.commit();
    return job;
  });
}

StoredJob JobTable::end_canceled(const JobClaim& claim, std::int64_t now_ns) {
  return database_->even_when_full([&] {
    Writing writing(*database_);
    StoredJob job = processing_job(writing.database(), claim);
    end(job, JobStatus::kCanceled, now_ns);
    update(writing.database(), job);
    writing.commit();
    return job;
  });
}

StoredJob JobTable::put_back(const JobClaim& claim, std::string_view error, std::int64_t now_ns,
                             Crashed crashed) {
  Writing writing(*database_);
  StoredJob job = processing_job(writing.database(), claim);
  put_back_or_cancel(job, error, now_ns, crashed);
  update(writing.database(), job);
  writing.commit();
  return job;
}

void JobTable::excuse(const JobClaim& claim) {
  Writing writing(*database_);
  (void)processing_job(writing.database(), claim);
  Statement(writing.database(), "UPDATE jobs SET beat = ? WHERE id = ?")
      .bind(kExcused)
      .bind(claim.id)
      .step();
  writing.commit();
}

std::size_t JobTable::put_back_all(std::string_view error, std::int64_t now_ns,
                                   std::string_view server) {
  Writing writing(*database_);
  std::vector<Beat> left;
  {
    Statement row(writing.database(), std::string(kSelectBeats) + " AND server IN (?, '')");
    left = beats_of(row.bind(server));
  }
  for (const Beat& last : left) {
    StoredJob job = processing_job(writing.database(), last.claim);
    put_back_or_cancel(job, error, now_ns, crashed_by(last));
    update(writing.database(), job);
  }
  writing.commit();
  return left.size();
}

StoredJob JobTable::request_cancel(std::int64_t id, std::int64_t now_ns) {
  return database_->even_when_full([&] {
    Writing writing(*database_);
    StoredJob job = known_job(writing.database(), id);
    if (job.status == JobStatus::kCanceled) {
      writing.commit();
      return job;
    }
    if (is_finished(job.status))
      throw StoreRefusal(Reason::kJobFinished, "job " + std::to_string(id) + " has " +
                                                   std::string(name_of(job.status)) + " already");
    if (job.result_version)
      throw StoreRefusal(Reason::kJobFinished, "job " + std::to_string(id) +
                                                   " has published version " +
                                                   in_quotes(*job.result_version) + " already");
    if (job.status == JobStatus::kEnqueued)
      end(job, JobStatus::kCanceled, now_ns);
    else
      job.cancel_requested = true;
    update(writing.database(), job);
    writing.commit();
    return job;
  });
}

StoredJob JobTable::job(std::int64_t id) const {
  const Reading reading(*database_);
  return known_job(reading.database(), id);
}

std::vector<std::int64_t> JobTable::drives(std::int64_t id) const {
  const Reading reading(*database_);
  (void)known_job(reading.database(), id);
  Statement row(reading.database(), "SELECT drive FROM job_drives WHERE job = ? ORDER BY drive");
  row.bind(id);
  std::vector<std::int64_t> drives;
  while (row.step()) drives.push_back(row.integer(0));
  return drives;
}

std::size_t JobTable::count(JobStatus status) const {
  const Reading reading(*database_);
  Statement row(reading.database(), "SELECT count(*) FROM jobs WHERE status = ?");
  row.bind(name_of(status)).step();
  return static_cast<std::size_t>(row.integer(0));
}

JobTable::Page JobTable::list(const Filter& filter, std::size_t limit,
                              std::optional<std::int64_t> before) const {
  if (limit < 1 || limit > kLargestJobPage)
    throw std::invalid_argument("limit: " + std::to_string(limit) + ", 1 to 1000 expected");
  std::string sql = std::string(kSelectJobs) + "WHERE true";
  if (filter.status) sql += " AND status = ?";
  if (filter.map) sql += " AND map = ?";
  for (std::size_t i = 0; i < filter.maps.size(); ++i)
    sql += i == 0 ? " AND (map LIKE ? ESCAPE '!'" : " OR map LIKE ? ESCAPE '!'";
  if (!filter.maps.empty()) sql += ")";
  if (before) sql += " AND id < ?";
  const Reading reading(*database_);
  // One more tells whether there are others.
  Statement row(reading.database(), sql + " ORDER BY id DESC LIMIT ?");
  if (filter.status) row.bind(name_of(*filter.status));
  if (filter.map) row.bind(*filter.map);
  for (const std::string& pattern : filter.maps) row.bind(like_of(pattern));
  if (before) row.bind(*before);
  row.bind(static_cast<std::int64_t>(limit) + 1);
  Page page;
  std::size_t bytes = 0;
  while (row.step()) {
    if (page.jobs.size() == limit || bytes > kMostPageBytes) {
      page.next = page.jobs.back().id;
      break;
    }
    page.jobs.push_back(job_of(row));
    bytes += page.jobs.back().request.size() + page.jobs.back().outcome.size();
  }
  return page;
}

std::vector<StoredJob> JobTable::unfinished() const {
  const Reading reading(*database_);
  // One statement: what is put back between two of them would stand in neither.
  Statement row(
      reading.database(),
      std::string(kSelectJobs) + "WHERE status IN ('enqueued', 'processing') ORDER BY id DESC");
  std::vector<StoredJob> jobs;
  while (row.step()) jobs.push_back(job_of(row));
  return jobs;
}

std::size_t JobTable::forget_finished_before(std::int64_t time_ns, std::int64_t of_drives_ns) {
  return database_->even_when_full([&] {
    Writing writing(*database_);
    Statement(writing.database(),
              "DELETE FROM jobs WHERE finished_ns < ? AND (finished_ns < ? OR NOT EXISTS"
              " (SELECT 1 FROM job_drives JOIN drives ON drives.id = job_drives.drive"
              " WHERE job_drives.job = jobs.id))")
        .bind(time_ns)
        .bind(of_drives_ns)
        .step();
    const std::int64_t gone = writing.database().changes();
    writing.commit();
    return static_cast<std::size_t>(gone);
  });
}

}  // namespace stillmap::server

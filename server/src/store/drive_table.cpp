#include "store/drive_table.hpp"

#include "store/map_name.hpp"

#include <stdexcept>

#include "store/map_rows.hpp"
#include "store/store_database.hpp"

namespace stillmap::server {
namespace {

using Reading = StoreDatabase::Reading;
using Reason = StoreRefusal::Reason;
using Writing = StoreDatabase::Writing;

constexpr const char* kSelectDrives =
    "SELECT id, map, name, CASE WHEN needs_choice <> 0 THEN 'needs_choice' ELSE status END, error, "
    "created_ns,"
    " finished_ns, (SELECT coalesce(sum(bytes), 0) FROM drive_parts WHERE drive = id), version,"
    " content_type, inspection, files_at FROM drives ";

DriveStatus status_of(const std::string& name) {
  for (const DriveStatus status : {DriveStatus::kOpen, DriveStatus::kNeedsChoice})
    if (name == name_of(status)) return status;
  return name == name_of(DriveStatus::kFailed) ? DriveStatus::kFailed : DriveStatus::kComplete;
}

StoredDrive drive_of(const Statement& row) {
  StoredDrive drive{.id = row.integer(0), .map = row.text(1), .name = row.text(2)};
  drive.status = status_of(row.text(3));
  drive.error = row.text(4);
  drive.created_ns = row.integer(5);
  drive.finished_ns = row.optional_integer(6);
  drive.bytes = static_cast<std::uint64_t>(row.integer(7));
  drive.target = {.version = row.optional_text(8).value_or(""),
                  .content_type = row.optional_text(9).value_or("")};
  drive.inspection = row.text(10);
  drive.files_at = row.text(11);
  return drive;
}

std::vector<StoredDrive> drives_of(Statement& row) {
  std::vector<StoredDrive> drives;
  while (row.step()) drives.push_back(drive_of(row));
  return drives;
}

StoredDrive known_drive(Database& database, std::int64_t id) {
  Statement row(database, std::string(kSelectDrives) + "WHERE id = ?");
  if (!row.bind(id).step())
    throw StoreRefusal(Reason::kUnknownDrive, "there is no drive " + std::to_string(id));
  return drive_of(row);
}

StoredDrive open_drive(Database& database, std::int64_t id) {
  StoredDrive drive = known_drive(database, id);
  if (drive.status != DriveStatus::kOpen)
    throw StoreRefusal(Reason::kDriveNotOpen,
                       drive_name(drive) + " is " + std::string(name_of(drive.status)));
  return drive;
}

StoredDrive finish(Database& database, StoredDrive drive, DriveStatus status,
                   std::string_view error, std::int64_t now_ns) {
  drive.status = status;
  drive.error = error;
  drive.finished_ns = now_ns;
  Statement(database,
            "UPDATE drives SET status = ?, needs_choice = 0, error = ?, finished_ns = ?,"
            " inspection = ? WHERE id = ?")
      .bind(name_of(status))
      .bind(error)
      .bind(now_ns)
      .bind(drive.inspection)
      .bind(drive.id)
      .step();
  return drive;
}

void check_part(const DrivePart& part) {
  if (part.n < 1 || part.n > DriveTable::kMostParts)
    throw std::invalid_argument("part: " + std::to_string(part.n) + ", 1 to 10000 expected");
  if (part.sha256.size() != 64 ||
      part.sha256.find_first_not_of("0123456789abcdef") != std::string::npos)
    throw std::invalid_argument("part: a SHA-256 of 64 hex digits expected");
  if (part.bytes > static_cast<std::uint64_t>(INT64_MAX))
    throw std::invalid_argument("part: " + std::to_string(part.bytes) + " bytes");
}

void check_no_gap(Database& database, const StoredDrive& drive) {
  Statement row(database, "SELECT count(*), max(n) FROM drive_parts WHERE drive = ?");
  row.bind(drive.id).step();
  const std::int64_t count = row.integer(0);
  if (count > 0 && count == row.integer(1)) return;
  throw StoreRefusal(Reason::kPartsMissing,
                     drive_name(drive) + " has " + std::to_string(count) +
                         (count == 0 ? " parts" : " parts up to number " + row.text(1)) +
                         ": send the missing ones");
}

void refuse_if_read(Database& database, std::int64_t id) {
  Statement row(database,
                "SELECT j.id FROM job_drives d JOIN jobs j ON j.id = d.job WHERE d.drive = ?"
                " AND j.status IN ('enqueued', 'processing')");
  if (row.bind(id).step())
    throw StoreRefusal(Reason::kInUse, "drive " + std::to_string(id) + " is read by job " +
                                           row.text(0) + ": wait for its end or cancel it");
}

}  // namespace

std::string drive_name(const StoredDrive& drive) {
  return (drive.is_upload() ? "upload " : "drive ") + std::to_string(drive.id);
}

std::string_view name_of(DriveStatus status) {
  switch (status) {
    case DriveStatus::kOpen:
      return "open";
    case DriveStatus::kNeedsChoice:
      return "needs_choice";
    case DriveStatus::kComplete:
      return "complete";
    case DriveStatus::kFailed:
      return "failed";
  }
  throw std::invalid_argument("not a status of a drive");
}

StoredDrive DriveTable::open(std::string_view map, std::string_view name, std::int64_t now_ns,
                             std::string_view files_at) {
  Writing writing(*database_);
  Database& database = writing.database();
  (void)known_map(database, map);
  const auto id = [&] {
    Statement row(database,
                  "INSERT INTO drives (map, name, status, created_ns, files_at)"
                  " VALUES (?, ?, 'open', ?, ?) RETURNING id");
    row.bind(map).bind(name).bind(now_ns).bind(files_at).step();
    return row.integer(0);
  }();
  StoredDrive drive = known_drive(database, id);
  writing.commit();
  return drive;
}

StoredDrive DriveTable::open_upload(std::string_view map, const UploadTarget& target,
                                    std::int64_t now_ns, std::string_view files_at) {
  if (!is_valid_map_name(target.version))
    throw std::invalid_argument("version: " + in_quotes(target.version) +
                                ", [a-z0-9][a-z0-9._-]{0,62} expected");
  Writing writing(*database_);
  Database& database = writing.database();
  (void)known_map(database, map);
  const auto id = [&] {
    Statement row(database,
                  "INSERT INTO drives (map, name, status, created_ns, version, content_type,"
                  " files_at) VALUES (?, '', 'open', ?, ?, ?, ?) RETURNING id");
    row.bind(map).bind(now_ns).bind(target.version).bind(target.content_type).bind(files_at).step();
    return row.integer(0);
  }();
  StoredDrive upload = known_drive(database, id);
  writing.commit();
  return upload;
}

bool DriveTable::add_part(std::int64_t id, const DrivePart& part, const StoreQuota& quota) {
  check_part(part);
  Writing writing(*database_);
  Database& database = writing.database();
  const StoredDrive drive = open_drive(database, id);
  {
    Statement row(database, "SELECT sha256 FROM drive_parts WHERE drive = ? AND n = ?");
    if (row.bind(id).bind(part.n).step()) {
      if (row.text(0) == part.sha256) {
        writing.commit();
        return false;
      }
      throw StoreRefusal(Reason::kOtherDigest, "part " + std::to_string(part.n) + " of " +
                                                   drive_name(drive) + " is " + row.text(0) +
                                                   " already: send the next part");
    }
  }
  refuse_over_quota(database, quota, {drive.map, part.bytes});
  Statement(database, "INSERT INTO drive_parts (drive, n, sha256, bytes) VALUES (?, ?, ?, ?)")
      .bind(id)
      .bind(part.n)
      .bind(part.sha256)
      .bind(static_cast<std::int64_t>(part.bytes))
      .step();
  writing.commit();
  return true;
}

std::vector<DrivePart> DriveTable::parts(std::int64_t id) const {
  const Reading reading(*database_);
  (void)known_drive(reading.database(), id);
  Statement row(reading.database(),
                "SELECT n, sha256, bytes FROM drive_parts WHERE drive = ? ORDER BY n");
  row.bind(id);
  std::vector<DrivePart> parts;
  while (row.step())
    parts.push_back({row.integer(0), row.text(1), static_cast<std::uint64_t>(row.integer(2))});
  return parts;
}

StoredDrive DriveTable::complete(std::int64_t id, std::int64_t now_ns,
                                 std::string_view inspection) {
  Writing writing(*database_);
  Database& database = writing.database();
  StoredDrive drive = known_drive(database, id);
  if (drive.status == DriveStatus::kComplete) {
    writing.commit();
    return drive;
  }
  if (drive.status != DriveStatus::kNeedsChoice) drive = open_drive(database, id);
  check_no_gap(database, drive);
  drive.inspection = inspection;
  drive = finish(database, std::move(drive), DriveStatus::kComplete, "", now_ns);
  writing.commit();
  return drive;
}

StoredDrive DriveTable::ask_for_choice(std::int64_t id, std::string_view error,
                                       std::string_view inspection) {
  Writing writing(*database_);
  Database& database = writing.database();
  StoredDrive drive = known_drive(database, id);
  if (drive.status != DriveStatus::kNeedsChoice) drive = open_drive(database, id);
  check_no_gap(database, drive);
  drive.status = DriveStatus::kNeedsChoice;
  drive.error = error;
  drive.inspection = inspection;
  Statement(database, "UPDATE drives SET needs_choice = 1, error = ?, inspection = ? WHERE id = ?")
      .bind(error)
      .bind(inspection)
      .bind(id)
      .step();
  writing.commit();
  return drive;
}

StoredDrive DriveTable::fail(std::int64_t id, std::string_view error, std::int64_t now_ns) {
  return database_->even_when_full([&] {
    Writing writing(*database_);
    StoredDrive drive = open_drive(writing.database(), id);
    drive = finish(writing.database(), std::move(drive), DriveStatus::kFailed, error, now_ns);
    writing.commit();
    return drive;
  });
}

StoredDrive DriveTable::drive(std::int64_t id) const {
  const Reading reading(*database_);
  return known_drive(reading.database(), id);
}

std::vector<StoredDrive> DriveTable::of_map(std::string_view map) const {
  const Reading reading(*database_);
  (void)known_map(reading.database(), map);
  Statement row(reading.database(),
                std::string(kSelectDrives) + "WHERE map = ? AND version IS NULL ORDER BY id");
  return drives_of(row.bind(map));
}

std::vector<StoredDrive> DriveTable::uploads_of_map(std::string_view map) const {
  const Reading reading(*database_);
  (void)known_map(reading.database(), map);
  Statement row(reading.database(),
                std::string(kSelectDrives) + "WHERE map = ? AND version IS NOT NULL ORDER BY id");
  return drives_of(row.bind(map));
}

std::vector<StoredDrive> DriveTable::all() const {
  const Reading reading(*database_);
  Statement row(reading.database(), std::string(kSelectDrives) + "ORDER BY id");
  return drives_of(row);
}

std::vector<std::int64_t> DriveTable::jobs_using(std::int64_t id) const {
  const Reading reading(*database_);
  (void)known_drive(reading.database(), id);
  Statement row(reading.database(), "SELECT job FROM job_drives WHERE drive = ? ORDER BY job");
  row.bind(id);
  std::vector<std::int64_t> jobs;
  while (row.step()) jobs.push_back(row.integer(0));
  return jobs;
}

void DriveTable::remove(std::int64_t id) {
  database_->even_when_full([&] {
    Writing writing(*database_);
    Database& database = writing.database();
    (void)known_drive(database, id);
    refuse_if_read(database, id);
    for (const char* sql :
         {"DELETE FROM drive_parts WHERE drive = ?", "DELETE FROM drives WHERE id = ?"})
      Statement(database, sql).bind(id).step();
    writing.commit();
  });
}

}  // namespace stillmap::server

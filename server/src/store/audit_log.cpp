#include "store/audit_log.hpp"

#include <stdexcept>
#include <string_view>

#include <stillmap/maps/sha256.hpp>
#include "store/audit_chain.hpp"
#include "store/store_database.hpp"

namespace stillmap::server {
namespace {

using Reading = StoreDatabase::Reading;
using ReadingBeside = StoreDatabase::ReadingBeside;
using Writing = StoreDatabase::Writing;

constexpr std::size_t kLargestPage = 1000;
constexpr std::int64_t kDayNs = 86'400'000'000'000;
/// What an int64 of nanoseconds can hold.
constexpr std::int64_t kMostDays = INT64_MAX / kDayNs;
constexpr const char* kSelect =
    "SELECT id, time_ns, request_id, server_request_id, source, key_id, method, route, subject,"
    " status, sha256 FROM audit ";

AuditRecord record_of(const Statement& row) {
  return {
      row.integer(0), row.integer(1), row.text(2), row.text(3), row.text(4),
      row.text(5),    row.text(6),    row.text(7), row.text(8), static_cast<int>(row.integer(9)),
      row.text(10)};
}

/// The record that the next one follows.
AuditStart newest(Database& database) {
  Statement row(database, "SELECT id, sha256 FROM audit ORDER BY id DESC LIMIT 1");
  if (row.step()) return {row.integer(0), row.text(1)};
  return audit_start(database);
}

}  // namespace

std::string chained_sha256(const std::string& before, const AuditRecord& record) {
  std::string text = before + "\n";
  const auto add = [&text](std::string_view field) {
    text += std::to_string(field.size()) + ":";
    text += field;
    text += '\n';
  };
  add(std::to_string(record.id));
  add(std::to_string(record.time_ns));
  for (const std::string* field : {&record.request_id, &record.server_request_id, &record.source,
                                   &record.key_id, &record.method, &record.route, &record.subject})
    add(*field);
  add(std::to_string(record.status));
  maps::Sha256 hash;
  hash.add(text.data(), text.size());
  return hash.hex();
}

AuditStart audit_start(Database& database) {
  Statement row(database, "SELECT id, sha256 FROM audit_start");
  if (!row.step()) return {};
  return {row.integer(0), row.text(1)};
}

void for_each_audit_record(Database& database,
                           const std::function<void(const AuditRecord&)>& visit) {
  // Page by page: an engine may keep all rows of a statement in memory.
  for (std::int64_t id = INT64_MIN;;) {
    Statement row(database, std::string(kSelect) + "WHERE id > ? ORDER BY id LIMIT 1000");
    row.bind(id);
    std::size_t rows = 0;
    for (; row.step(); ++rows) {
      const AuditRecord record = record_of(row);
      visit(record);
      id = record.id;
    }
    if (rows == 0) return;
  }
}

void chain_old_audit_records(Database& database) {
  std::string before = audit_start(database).sha256;
  // One by one, so that no row is changed under a statement that reads on.
  for (std::int64_t id = INT64_MIN;;) {
    Statement row(database, std::string(kSelect) + "WHERE id > ? ORDER BY id LIMIT 1");
    if (!row.bind(id).step()) return;
    const AuditRecord record = record_of(row);
    before = chained_sha256(before, record);
    id = record.id;
    Statement(database, "UPDATE audit SET sha256 = ? WHERE id = ?").bind(before).bind(id).step();
  }
}

std::int64_t AuditLog::append(const AuditRecord& record) {
  // Reads the record before within the transaction, so that two servers on one store never both
  // follow the same one.
  Writing writing(*database_);
  const AuditStart before = newest(writing.database());
  AuditRecord row = record;
  row.id = before.id + 1;
  Statement(writing.database(),
            "INSERT INTO audit (id, time_ns, request_id, server_request_id, source, key_id,"
            " method, route, subject, status, sha256)"
            " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)")
      .bind(row.id)
      .bind(row.time_ns)
      .bind(row.request_id)
      .bind(row.server_request_id)
      .bind(row.source)
      .bind(row.key_id)
      .bind(row.method)
      .bind(row.route)
      .bind(row.subject)
      .bind(std::int64_t{row.status})
      .bind(chained_sha256(before.sha256, row))
      .step();
  writing.commit();
  return row.id;
}

AuditLog::Page AuditLog::list(std::size_t limit, std::optional<std::int64_t> before) const {
  if (limit < 1 || limit > kLargestPage)
    throw std::invalid_argument("limit: " + std::to_string(limit) + ", 1 to 1000 expected");
  const Reading reading(*database_);
  // One more tells whether there are others.
  Statement row(reading.database(), std::string(kSelect) + "WHERE id < ? ORDER BY id DESC LIMIT ?");
  row.bind(before.value_or(INT64_MAX)).bind(static_cast<std::int64_t>(limit) + 1);
  Page page;
  while (row.step()) page.records.push_back(record_of(row));
  if (page.records.size() > limit) {
    page.records.pop_back();
    page.next = page.records.back().id;
  }
  return page;
}

void AuditLog::for_each(
    const std::function<void(const AuditRecord&, const std::string& before)>& visit) const {
  const ReadingBeside reading(*database_);
  const Transaction snapshot(reading.database(), Transaction::For::kReading);
  std::string before = audit_start(reading.database()).sha256;
  for_each_audit_record(reading.database(), [&](const AuditRecord& record) {
    visit(record, before);
    before = record.sha256;
  });
}

AuditLog::Check AuditLog::check() const {
  const ReadingBeside reading(*database_);
  const Transaction snapshot(reading.database(), Transaction::For::kReading);
  const AuditStart start = audit_start(reading.database());
  Check check{.newest_id = start.id, .newest_sha256 = start.sha256};
  for_each_audit_record(reading.database(), [&](const AuditRecord& record) {
    ++check.records;
    const bool fits =
        record.id > check.newest_id && record.sha256 == chained_sha256(check.newest_sha256, record);
    if (!fits && !check.first_wrong_id) check.first_wrong_id = record.id;
    check.newest_id = record.id;
    check.newest_sha256 = record.sha256;
  });
  // Whoever removes the newest records leaves the counter.
  if (!check.first_wrong_id && check.newest_id != reading.database().last_id("audit"))
    check.first_wrong_id = check.newest_id + 1;
  return check;
}

std::size_t AuditLog::remove_older_than(std::int64_t days, std::int64_t now_ns) {
  if (days < 1 || days > kMostDays)
    throw std::invalid_argument("retention: " + std::to_string(days) + " days");
  const std::int64_t oldest_ns = now_ns - days * kDayNs;
  Writing writing(*database_);
  Database& database = writing.database();
  // Only from the beginning of the chain on: the first that is young enough keeps all behind it.
  // The sign keeps SQLite from reading all times, sorted, in place of the first rows.
  Statement first(database, "SELECT id FROM audit WHERE +time_ns >= ? ORDER BY id LIMIT 1");
  const std::int64_t kept = first.bind(oldest_ns).step() ? first.integer(0) : INT64_MAX;
  Statement last(database, "SELECT id, sha256 FROM audit WHERE id < ? ORDER BY id DESC LIMIT 1");
  if (!last.bind(kept).step()) return 0;
  Statement(database, "UPDATE audit_start SET id = ?, sha256 = ?")
      .bind(last.integer(0))
      .bind(last.text(1))
      .step();
  Statement(database, "DELETE FROM audit WHERE id < ?").bind(kept).step();
  const std::int64_t gone = database.changes();
  writing.commit();
  return static_cast<std::size_t>(gone);
}

}  // namespace stillmap::server

#include <stillmap/maps/store/audit_log.hpp>

#include <stdexcept>

#include "store/store_database.hpp"

namespace stillmap::maps {
namespace {

using Reading = StoreDatabase::Reading;
using Writing = StoreDatabase::Writing;

constexpr std::size_t kLargestPage = 1000;
constexpr std::int64_t kDayNs = 86'400'000'000'000;
/// What an int64 of nanoseconds can hold.
constexpr std::int64_t kMostDays = INT64_MAX / kDayNs;

}  // namespace

std::int64_t AuditLog::append(const AuditRecord& record) {
  Writing writing(*database_);
  SqliteStatement(writing.database(),
                  "INSERT INTO audit (time_ns, request_id, server_request_id, source, key_id,"
                  " method, route, subject, status) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)")
      .bind(record.time_ns)
      .bind(record.request_id)
      .bind(record.server_request_id)
      .bind(record.source)
      .bind(record.key_id)
      .bind(record.method)
      .bind(record.route)
      .bind(record.subject)
      .bind(std::int64_t{record.status})
      .step();
  const std::int64_t id = writing.database().inserted();
  writing.commit();
  return id;
}

AuditLog::Page AuditLog::list(std::size_t limit, std::optional<std::int64_t> before) const {
  if (limit < 1 || limit > kLargestPage)
    throw std::invalid_argument("limit: " + std::to_string(limit) + ", 1 to 1000 expected");
  const Reading reading(*database_);
  // One more tells whether there are others.
  SqliteStatement row(reading.database(),
                      "SELECT id, time_ns, request_id, server_request_id, source, key_id, method,"
                      " route, subject, status FROM audit WHERE id < ? ORDER BY id DESC LIMIT ?");
  row.bind(before.value_or(INT64_MAX)).bind(static_cast<std::int64_t>(limit) + 1);
  Page page;
  while (row.step())
    page.records.push_back({row.integer(0), row.integer(1), row.text(2), row.text(3), row.text(4),
                            row.text(5), row.text(6), row.text(7), row.text(8),
                            static_cast<int>(row.integer(9))});
  if (page.records.size() > limit) {
    page.records.pop_back();
    page.next = page.records.back().id;
  }
  return page;
}

std::size_t AuditLog::remove_older_than(std::int64_t days, std::int64_t now_ns) {
  if (days < 1 || days > kMostDays)
    throw std::invalid_argument("retention: " + std::to_string(days) + " days");
  Writing writing(*database_);
  SqliteStatement(writing.database(), "DELETE FROM audit WHERE time_ns < ?")
      .bind(now_ns - days * kDayNs)
      .step();
  const std::int64_t gone = writing.database().changes();
  writing.commit();
  return static_cast<std::size_t>(gone);
}

}  // namespace stillmap::maps

#pragma once

#include "store/audit_log.hpp"

#include <cstdint>
#include <functional>
#include <string>

namespace stillmap::server {

class Database;

/// What the first record follows: the newest one that was ever removed.
struct AuditStart {
  /// 0: none was.
  std::int64_t id = 0;
  std::string sha256{};
};

/// @return SHA-256, in hex, over that of the record before, a line feed, and the record's canonical
/// text: for each of its fields but the SHA-256, in the order in which `AuditRecord` declares them,
/// the number of its bytes, a colon, the field and a line feed. Integers are decimal.
[[nodiscard]] std::string chained_sha256(const std::string& before, const AuditRecord& record);
[[nodiscard]] AuditStart audit_start(Database& database);
/// Calls for every record, oldest first.
void for_each_audit_record(Database& database,
                           const std::function<void(const AuditRecord&)>& visit);
/// The second half of the schema's step that made the chain: gives a hash to every record that has
/// none yet.
void chain_old_audit_records(Database& database);

}  // namespace stillmap::server

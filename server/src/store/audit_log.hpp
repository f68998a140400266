#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::server {

class StoreDatabase;

/// A write that a client asked for, and how it ended.
struct AuditRecord {
  /// Given by the log, growing; 0 in what is appended.
  std::int64_t id = 0;
  std::int64_t time_ns = 0;
  /// As it was answered: the client's own where it sent one, which may come twice.
  std::string request_id{};
  /// The server's own, never twice. Empty in rows of older versions.
  std::string server_request_id{};
  /// Address of the client. Empty in rows of older versions.
  std::string source{};
  /// Empty without keys.
  std::string key_id{};
  std::string method{};
  /// The pattern, as "/v1/maps/{map}".
  std::string route{};
  /// What it was about, as "town/v2".
  std::string subject{};
  /// HTTP's.
  int status = 0;
  /// Of the record before and this one, in hex: see `AuditLog`. Empty in what is appended.
  std::string sha256{};
  auto operator<=>(const AuditRecord&) const = default;
};

/// Append-only record of writes; the database itself refuses to change a row. What returned is
/// kept. Safe from several threads and processes. Throws StorageError when the disk fails.
///
/// The records are chained: the SHA-256 of each covers that of the record before and its own text
/// (server/store.md), so that one which was changed, removed or put in between no longer fits.
/// Whoever can write the file can compute the whole chain anew: keep the newest hash elsewhere.
class AuditLog {
 public:
  /// @return its id.
  std::int64_t append(const AuditRecord& record);

  struct Page {
    /// Newest first.
    std::vector<AuditRecord> records;
    /// Pass as `before` for those that follow; nothing at the end.
    std::optional<std::int64_t> next;
  };
  /// @param limit  1 to 1000. @throws std::invalid_argument.
  [[nodiscard]] Page list(std::size_t limit, std::optional<std::int64_t> before = {}) const;
  /// Calls for every record, oldest first, as of one instant. @param visit  gets the record and the
  /// SHA-256 of the one before it, which may be removed already; 64 zeros before the first.
  void for_each(
      const std::function<void(const AuditRecord&, const std::string& before)>& visit) const;

  struct Check {
    std::size_t records = 0;
    /// Of the newest record; of the last removed one where there is none.
    std::int64_t newest_id = 0;
    std::string newest_sha256{};
    /// The first record that does not fit to the one before it, or that is missing at the end.
    std::optional<std::int64_t> first_wrong_id{};
  };
  /// Recomputes the chain.
  [[nodiscard]] Check check() const;
  /// The one way in which records go: from the oldest on, up to the first that is younger.
  /// @param days  1 or more. @return how many went.
  /// @throws std::invalid_argument.
  std::size_t remove_older_than(std::int64_t days, std::int64_t now_ns);

 private:
  friend class StoreState;
  explicit AuditLog(StoreDatabase& database) : database_(&database) {}
  StoreDatabase* database_;
};

}  // namespace stillmap::server

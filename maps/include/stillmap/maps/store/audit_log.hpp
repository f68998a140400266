#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::maps {

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
  auto operator<=>(const AuditRecord&) const = default;
};

/// Append-only record of writes; the database itself refuses to change a row. What returned is
/// kept. Safe from several threads. Throws StorageError when the disk fails.
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
  /// The one way in which records go. @param days  1 or more. @return how many went.
  /// @throws std::invalid_argument.
  std::size_t remove_older_than(std::int64_t days, std::int64_t now_ns);

 private:
  friend class StoreState;
  explicit AuditLog(StoreDatabase& database) : database_(&database) {}
  StoreDatabase* database_;
};

}  // namespace stillmap::maps

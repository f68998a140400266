#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace stillmap::server {

class StoreDatabase;

/// Keys of sealed sessions where servers share a state; a store of its own has them in a file. No
/// copy and no backup of a state has them. Safe from several threads.
class SealKeyTable {
 public:
  struct Row {
    /// 64 hex digits.
    std::string secret;
    std::int64_t made_ns = 0;
    friend bool operator==(const Row&, const Row&) = default;
  };

  explicit SealKeyTable(StoreDatabase& database) : database_(&database) {}

  /// The newest first, two at most.
  [[nodiscard]] std::vector<Row> newest() const;
  /// Becomes the newest one. @throws StorageError.
  void add(const Row& row);
  /// The same, unless there is one. @throws StorageError.
  void add_first(const Row& row);

 private:
  StoreDatabase* database_;
};

}  // namespace stillmap::server

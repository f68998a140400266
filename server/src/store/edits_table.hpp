#pragma once

#include "store/store_refusal.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::server {

class StoreDatabase;

/// Corrections that people keep for a map.
struct SavedEdits {
  /// As `parse_edits` reads it; `kNoEdits` when none were saved.
  std::string text{};
  /// Of the text, hex.
  std::string sha256{};
  /// When they were saved; nothing when none were.
  std::optional<std::int64_t> saved_ns{};
  /// Id of the key of who saved them; empty without keys.
  std::string saver{};
  auto operator<=>(const SavedEdits&) const = default;
};

/// Corrections of the maps of a store, for their next rebuilds; they go with their map. What
/// returned is kept. Safe from several threads. Throws StorageError when the disk fails,
/// StoreRefusal kUnknownMap.
class EditsTable {
 public:
  /// Longest text [bytes].
  static constexpr std::size_t kMostBytes = std::size_t{1} << 20U;

  [[nodiscard]] SavedEdits of_map(std::string_view map) const;
  /// Takes the place of those before.
  /// @param text    of `parse_edits`: the caller has looked at it.
  /// @param before  SHA-256 of the text that must be there still; nothing: whatever is there.
  /// @throws StoreRefusal kOtherRevision; std::invalid_argument for a text that is too long.
  SavedEdits save(std::string_view map, std::string_view text, std::string_view saver,
                  std::int64_t now_ns, const std::optional<std::string>& before = {});

 private:
  friend class StoreState;
  explicit EditsTable(StoreDatabase& database) : database_(&database) {}
  StoreDatabase* database_;
};

}  // namespace stillmap::server

#pragma once

#include "store/store_refusal.hpp"

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace stillmap::server {

class StoreDatabase;

/// What a key allows. None includes another.
enum class KeyScope : std::uint8_t { kRead = 1, kLocalize = 2, kWrite = 4, kAdmin = 8 };

/// "read", "localize", "write", "admin".
[[nodiscard]] std::string_view name_of(KeyScope scope);
/// All of them, in the order above.
[[nodiscard]] const std::vector<KeyScope>& all_key_scopes();

/// A set of scopes.
struct KeyScopes {
  std::uint8_t bits = 0;
  [[nodiscard]] constexpr bool has(KeyScope scope) const {
    return (bits & static_cast<std::uint8_t>(scope)) != 0;
  }
  constexpr void add(KeyScope scope) {
    bits = static_cast<std::uint8_t>(bits | static_cast<std::uint8_t>(scope));
  }
  auto operator<=>(const KeyScopes&) const = default;
};

/// Most patterns of maps that one key is limited to.
inline constexpr std::size_t kMostMapPatterns = 32;
/// Whether it is 1 to 63 of `[a-z0-9._-]` and `*`.
[[nodiscard]] bool is_map_pattern(std::string_view text);
/// Whether a name is what a pattern says: `*` stands for any text, also none, and everything else
/// for itself.
[[nodiscard]] bool matches_pattern(std::string_view name, std::string_view pattern);

/// What is known of a key; never its secret.
struct ApiKey {
  /// Public and random.
  std::string id{};
  /// As its maker called it.
  std::string name{};
  KeyScopes scopes{};
  std::int64_t created_ns = 0;
  /// From then on it is refused; nothing: never.
  std::optional<std::int64_t> expires_ns{};
  std::optional<std::int64_t> revoked_ns{};
  /// Patterns of names of the maps that it may be used for; none: all maps.
  std::vector<std::string> maps{};
  auto operator<=>(const ApiKey&) const = default;
};

/// Answer to a key that a client sent.
struct KeyCheck {
  enum class Verdict : std::uint8_t { kGood, kUnknown, kRevoked, kExpired };
  Verdict verdict = Verdict::kUnknown;
  /// Unless unknown: a client with the wrong secret does not learn which ids there are.
  std::optional<ApiKey> key{};
};

/// Keys of a store. The text `stillmap_<id>_<secret>` has 256 random bits of secret, is told once
/// and kept as its SHA-256 only; so many bits need no slow hash. Safe from several threads. Throws
/// StorageError when the disk fails.
class KeyTable {
 public:
  struct Created {
    ApiKey key;
    /// What the client sends. Told here only.
    std::string text;
  };
  /// @param maps  patterns of names of maps; none: all maps.
  /// @throws std::invalid_argument when the name is empty, longer than 100 bytes or has control
  /// characters, there is no scope, it would have expired already, a pattern is none, there are
  /// more than `kMostMapPatterns`, or there are some beside the scope admin.
  Created create(std::string_view name, KeyScopes scopes, std::optional<std::int64_t> expires_ns,
                 std::int64_t now_ns, const std::vector<std::string>& maps = {});
  /// Oldest first, with those that are revoked or expired.
  [[nodiscard]] std::vector<ApiKey> list() const;
  /// For good. One that is revoked already stays as it is. @throws StoreRefusal kUnknownKey.
  ApiKey revoke(std::string_view id, std::int64_t now_ns);
  /// Any text may be given. Takes the same time for a wrong secret and an unknown id, waits for no
  /// writer, and sees what another process created or revoked: at once in SQLite, within a second
  /// in PostgreSQL. While that is away, the keys that were read last count.
  [[nodiscard]] KeyCheck check(std::string_view text, std::int64_t now_ns) const;
  /// Whether there is any, expired and revoked ones included. As `check` otherwise.
  [[nodiscard]] bool any() const;

 private:
  friend class StoreState;
  explicit KeyTable(StoreDatabase& database) : database_(&database) {}
  StoreDatabase* database_;
  struct Known {
    ApiKey key;
    std::string secret_sha256;
  };
  using KnownKeys = std::map<std::string, Known, std::less<>>;
  [[nodiscard]] std::shared_ptr<const KnownKeys> known() const;
  /// The same, as the database has them now.
  [[nodiscard]] std::shared_ptr<const KnownKeys> read() const;
  void follow(const std::stop_token& stop) const;
  void note_change();
  mutable std::mutex mutex_;
  /// By id, and the database's mark when they were read.
  mutable std::shared_ptr<const KnownKeys> known_;
  mutable std::int64_t known_at_ = 0;
  /// After the newest change that was made here, which counts at once.
  std::int64_t needed_at_ = 0;
  mutable std::once_flag is_followed_;
  /// Reads again what others change in PostgreSQL. Last: it uses all of the above.
  mutable std::jthread follower_;
};

}  // namespace stillmap::server

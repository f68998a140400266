#pragma once

#include <stillmap/maps/error.hpp>
#include "store/database.hpp"

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

// libpq's PGconn and PGresult.
struct pg_conn;
struct pg_result;

namespace stillmap::server {

/// The state cannot be reached, or takes no changes now. Asked again later it may answer; a change
/// whose outcome is not known may be asked for again, as after any StorageError.
class StateAway : public maps::StorageError {
 public:
  using maps::StorageError::StorageError;
};

/// Where a state in PostgreSQL is: `postgres://` or `postgresql://`, as libpq reads it, several
/// hosts included. A password belongs into ~/.pgpass or PGPASSFILE; one in the address is kept out
/// of messages.
class PostgresAddress {
 public:
  /// Whether a text is such an address, and no path of a file.
  [[nodiscard]] static bool is_one(std::string_view text);
  /// @throws InputError when libpq cannot read it, or is not there.
  explicit PostgresAddress(std::string text);
  /// For libpq.
  [[nodiscard]] const std::string& text() const { return text_; }
  /// For messages.
  [[nodiscard]] const std::string& name() const { return name_; }

 private:
  std::string text_;
  std::string name_;
};

/// Counts the changes of a state in PostgreSQL: told by NOTIFY, and looked for in between. While
/// the state is away it stays as it is.
class PostgresWatch {
 public:
  explicit PostgresWatch(const PostgresAddress& address);
  PostgresWatch(const PostgresWatch&) = delete;
  PostgresWatch& operator=(const PostgresWatch&) = delete;
  ~PostgresWatch() = default;
  [[nodiscard]] std::int64_t mark() const { return mark_; }
  /// This process has changed something, and will not wait until it is told.
  void bump() { ++mark_; }
  /// It cannot be reached, or hangs: noticed after some 3 s.
  [[nodiscard]] bool is_away() const { return is_away_; }
  /// How often its own connection was lost. One that is older than that may be, too.
  [[nodiscard]] std::int64_t losses() const { return losses_; }
  /// Since PostgreSQL answered last.
  [[nodiscard]] std::chrono::steady_clock::duration silence() const {
    return std::chrono::steady_clock::now() - heard_at_.load();
  }

 private:
  void watch(const std::stop_token& stop);
  PostgresAddress address_;
  std::atomic<std::int64_t> mark_ = 0;
  std::atomic<std::int64_t> losses_ = 0;
  std::atomic<bool> is_away_ = false;
  std::atomic<std::chrono::steady_clock::time_point> heard_at_{std::chrono::steady_clock::now()};
  std::jthread thread_;  // last: it uses all of the above
};

/// A connection to PostgreSQL 15 or newer. Tables are in the schema `stillmap`. One that is lost is
/// made again at the next use, with another host where the address names several. Commits return
/// when synchronous standbys, where there are some, have applied them. No call waits for ever: what
/// has no answer in time throws StateAway.
class PostgresDatabase final : public Database {
 public:
  /// @param watch  outlives this. @throws StateAway.
  PostgresDatabase(const PostgresAddress& address, PostgresWatch& watch);
  ~PostgresDatabase() override;

  [[nodiscard]] const std::string& name() const override { return address_.name(); }
  void execute(const std::string& sql) override;
  [[nodiscard]] std::unique_ptr<EngineStatement> prepare(std::string_view sql) override;
  [[nodiscard]] std::int64_t changes() const override { return changes_; }
  [[nodiscard]] std::int64_t change_mark() override { return watch_.mark(); }
  [[nodiscard]] std::int64_t last_id(std::string_view table) override;
  void set_last_id(std::string_view table, std::int64_t id) override;
  void begin_writing() override;
  void begin_reading() override;
  void commit() override;
  void roll_back() noexcept override;

  /// Waits for the lock of servers that move packages, at most a minute, and holds it as long as
  /// this connection. A connection can be lost in silence, and another server then gets the lock:
  /// @return the number of this holder, which is `last_id(kHolderOfPackages)` until there is
  /// another one. @throws StateAway.
  std::int64_t lock_packages();
  static constexpr const char* kHolderOfPackages = "packages";

  struct Clear {
    void operator()(pg_result* result) const;
  };
  using Result = std::unique_ptr<pg_result, Clear>;
  /// A parameter; nothing is NULL.
  struct Value {
    /// As PostgreSQL numbers them.
    unsigned type = 0;
    std::optional<std::string> text;
  };
  /// @param sql  with $1, $2, ... @throws StateAway; StorageError for what is wrong with it.
  Result run(const std::string& sql, const std::vector<Value>& values);

 private:
  void connect();
  void disconnect() noexcept;
  void lock_to_write();
  Result send(const std::string& sql, const std::vector<Value>& values,
              std::chrono::milliseconds longest);
  /// @param send  with one of libpq's functions. @throws StateAway also when it takes longer.
  Result answer(const std::function<int()>& send, std::chrono::milliseconds longest);
  /// @throws what a result that failed means.
  void check(pg_result* result);
  static void note(void* self, const pg_result* notice);

  PostgresAddress address_;
  PostgresWatch& watch_;
  pg_conn* connection_ = nullptr;
  bool in_transaction_ = false;
  /// Those of the watch when this connection was made.
  std::int64_t losses_ = 0;
  /// A commit is here, but a standby may not have it.
  bool not_replicated_ = false;
  std::int64_t changes_ = 0;
  /// After a failure the next try waits, so that nobody waits long for what is away.
  std::chrono::steady_clock::time_point try_again_{};
  std::string away_because_;
};

}  // namespace stillmap::server

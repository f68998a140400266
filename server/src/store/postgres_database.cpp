#include "store/postgres_database.hpp"

#include "store/libpq.hpp"

#include <poll.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <functional>
#include <optional>
#include <utility>

namespace stillmap::server {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

/// Of PostgreSQL's catalog of types, where they are for ever.
constexpr Oid kInteger = 20, kText = 25, kReal = 701;
/// "STMP": who writes to this state holds the advisory lock of this number.
constexpr const char* kLockToWrite = "SELECT pg_advisory_xact_lock(1398033744)";
constexpr const char* kLockOfPackages = "SELECT pg_advisory_lock(1398033745)";
constexpr const char* kCountHolder =
    "INSERT INTO given_ids AS known (name, last) VALUES (?, 1)"
    " ON CONFLICT (name) DO UPDATE SET last = known.last + 1 RETURNING last";
/// Whether a commit would wait for a standby that is not there, or that does not answer to one that
/// was made before. Who may not see what standbys do (`GRANT pg_monitor` lets a role) learns it by
/// waiting.
constexpr const char* kStandbyIsAway =
    "SELECT 1 WHERE current_setting('synchronous_standby_names') <> '' AND (NOT EXISTS"
    " (SELECT 1 FROM pg_stat_replication WHERE sync_state IN ('sync', 'quorum')"
    " OR sync_state IS NULL) OR EXISTS (SELECT 1 FROM pg_stat_activity"
    " WHERE wait_event = 'SyncRep' AND query_start < now() - interval '5 s'))";
constexpr const char* kTellAll =
    "WITH counted AS (UPDATE changes SET n = n + 1) SELECT pg_notify('stillmap', '')";
constexpr milliseconds kTryAgain{500};
constexpr milliseconds kLookEvery{200};
/// How long to wait for an answer. PostgreSQL itself ends a statement after 10 s, but one that
/// hangs (a frozen machine, a stuck disk) ends nothing, and no timeout of TCP notices it.
constexpr milliseconds kLongestAnswer{12'000};
constexpr milliseconds kLongestAnswerToWatch{3'000};
/// PostgreSQL's own limit does not count while a commit waits for its standby.
constexpr milliseconds kLongestCommit{10'000};
constexpr milliseconds kLongestWaitForPackages{62'000};

/// A pose never waits for these; a change waits no longer than for SQLite's lock. PostgreSQL keeps
/// the locks of a machine that was cut off until it finds out, which by itself takes two hours.
constexpr const char* kSession =
    "SET search_path TO stillmap;"
    "SET client_min_messages TO warning; SET synchronous_commit TO remote_apply;"
    "SET lock_timeout TO '10s'; SET statement_timeout TO '10s';"
    "SET idle_in_transaction_session_timeout TO '10s';"
    "SET tcp_keepalives_idle TO 5; SET tcp_keepalives_interval TO 2;"
    "SET tcp_keepalives_count TO 2; SET tcp_user_timeout TO 3000;";

PGconn* connected(const PostgresAddress& address) {
  // What stands in the address comes later, so it wins.
  const char* const names[] = {"target_session_attrs",
                               "connect_timeout",
                               "tcp_user_timeout",
                               "keepalives_idle",
                               "keepalives_interval",
                               "keepalives_count",
                               "client_encoding",
                               "application_name",
                               "dbname",
                               nullptr};
  const char* const values[] = {
      "read-write",           "2",    "3000", "5", "2", "2", "UTF8", "stillmap",
      address.text().c_str(), nullptr};
  PGconn* const connection = libpq().connect(names, values, 1);
  // Also what is sent must not wait for ever.
  if (connection != nullptr) libpq().set_nonblocking(connection, 1);
  return connection;
}

using GiveUp = std::function<bool()>;

/// @return whether the socket is ready before the deadline.
bool is_ready(int socket, short events, steady_clock::time_point deadline, const GiveUp& give_up) {
  while (socket >= 0) {
    const auto left = std::chrono::ceil<milliseconds>(deadline - steady_clock::now());
    if (left.count() <= 0) return false;
    pollfd waiting{socket, events, 0};
    const int ready = ::poll(&waiting, 1, static_cast<int>(std::min(left, kLookEvery).count()));
    if (ready > 0) return true;
    if (ready < 0 && errno != EINTR) return false;
    if (give_up()) return false;
  }
  return false;
}

/// Sends with one of libpq's functions, and waits for the result of the last statement.
/// @param give_up  asked while there is no answer. @return null when the connection is lost, or
/// when there is no answer within `longest`: the connection is then good for nothing but to be
/// closed.
PostgresDatabase::Result exec_within(PGconn* connection, milliseconds longest,
                                     const GiveUp& give_up, const std::function<int()>& send) {
  const Libpq& pq = libpq();
  const auto deadline = steady_clock::now() + longest;
  if (send() == 0) return nullptr;
  PostgresDatabase::Result last;
  const auto receive = [&](short events) {
    return is_ready(pq.socket(connection), events, deadline, give_up) &&
           pq.consume(connection) != 0;
  };
  while (true) {
    const int unsent = pq.flush(connection);
    if (unsent < 0 || (unsent > 0 && !receive(POLLIN | POLLOUT))) return nullptr;
    if (unsent > 0) continue;
    if (pq.is_busy(connection) != 0) {
      if (receive(POLLIN)) continue;
      // Before PostgreSQL closes a connection it says why.
      const bool says_why = last && pq.result_status(last.get()) == PGRES_FATAL_ERROR;
      return says_why ? std::move(last) : nullptr;
    }
    PGresult* const next = pq.next_result(connection);
    if (next == nullptr) return last;
    last.reset(next);
  }
}

/// "town: no route\n\n" -> "town: no route"
std::string one_line(const char* text) {
  std::string line = text == nullptr ? "" : text;
  while (!line.empty() && (line.back() == '\n' || line.back() == ' ')) line.pop_back();
  for (char& c : line)
    if (c == '\n') c = ' ';
  return line;
}

/// `?` and `?1` as `$1`.
std::string numbered(std::string_view sql) {
  std::string out;
  int next = 0;
  bool in_text = false;
  for (std::size_t i = 0; i < sql.size(); ++i) {
    if (sql[i] == '\'') in_text = !in_text;
    if (sql[i] != '?' || in_text) {
      out += sql[i];
      continue;
    }
    out += '$';
    if (i + 1 >= sql.size() || sql[i + 1] < '0' || sql[i + 1] > '9') out += std::to_string(++next);
  }
  return out;
}

class PostgresStatement final : public EngineStatement {
 public:
  PostgresStatement(PostgresDatabase& database, std::string_view sql)
      : database_(database), sql_(numbered(sql)) {}
  void bind_text(int parameter, const std::optional<std::string_view>& text) override {
    if (text && text->find('\0') != std::string_view::npos)
      throw maps::StorageError(database_.name(),
                               "a text holds a zero byte, which PostgreSQL keeps in no text: send "
                               "it without");
    put(parameter, {kText, text ? std::optional<std::string>(*text) : std::nullopt});
  }
  void bind_integer(int parameter, const std::optional<std::int64_t>& number) override {
    put(parameter,
        {kInteger, number ? std::optional<std::string>(std::to_string(*number)) : std::nullopt});
  }
  void bind_real(int parameter, double number) override {
    char text[32];
    const auto [end, error] = std::to_chars(text, text + sizeof(text), number);
    put(parameter, {kReal, std::string(text, end)});
  }
  bool step() override {
    if (result_ == nullptr)
      result_ = database_.run(sql_, values_);
    else
      ++row_;
    return row_ < libpq().rows(result_.get());
  }
  [[nodiscard]] std::optional<std::string> text(int column) const override {
    if (libpq().is_null(result_.get(), row_, column) != 0) return std::nullopt;
    return std::string(libpq().value(result_.get(), row_, column),
                       static_cast<std::size_t>(libpq().length(result_.get(), row_, column)));
  }
  [[nodiscard]] std::optional<std::int64_t> integer(int column) const override {
    return parsed<std::int64_t>(column);
  }
  [[nodiscard]] double real(int column) const override {
    return parsed<double>(column).value_or(0.0);
  }

 private:
  void put(int parameter, PostgresDatabase::Value value) {
    values_.resize(std::max(values_.size(), static_cast<std::size_t>(parameter)));
    values_[static_cast<std::size_t>(parameter) - 1] = std::move(value);
  }
  template <typename Number>
  [[nodiscard]] std::optional<Number> parsed(int column) const {
    const std::optional<std::string> digits = text(column);
    if (!digits) return std::nullopt;
    Number number{};
    const auto [end, error] =
        std::from_chars(digits->data(), digits->data() + digits->size(), number);
    if (error != std::errc() || end != digits->data() + digits->size())
      throw maps::StorageError(database_.name(), "found '" + *digits + "' where a number was read");
    return number;
  }

  PostgresDatabase& database_;
  std::string sql_;
  std::vector<PostgresDatabase::Value> values_;
  PostgresDatabase::Result result_;
  int row_ = 0;
};

}  // namespace

bool PostgresAddress::is_one(std::string_view text) {
  return text.starts_with("postgres://") || text.starts_with("postgresql://");
}

PostgresAddress::PostgresAddress(std::string text) : text_(std::move(text)) {
  char* error = nullptr;
  PQconninfoOption* const options = is_one(text_) ? libpq().parse(text_.c_str(), &error) : nullptr;
  if (options == nullptr) {
    libpq().free(error);
    // libpq's words hold the whole text, and so a password.
    throw maps::InputError("the state's address", "what is no address of PostgreSQL",
                           "postgres://user@host:5432/database, or several hosts with commas");
  }
  const auto value = [&](const char* keyword) {
    for (const PQconninfoOption* each = options; each->keyword != nullptr; ++each)
      if (std::strcmp(each->keyword, keyword) == 0 && each->val != nullptr)
        return std::string(each->val);
    return std::string();
  };
  const std::string hosts = value("host"), ports = value("port"), base = value("dbname");
  name_ = "postgres://" + (hosts.empty() ? "localhost" : hosts) +
          (ports.empty() ? "" : ":" + ports) + "/" + base;
  libpq().free_parsed(options);
}

void PostgresDatabase::Clear::operator()(pg_result* result) const { libpq().clear(result); }

PostgresDatabase::PostgresDatabase(const PostgresAddress& address, PostgresWatch& watch)
    : address_(address), watch_(watch) {
  connect();
}

PostgresDatabase::~PostgresDatabase() { disconnect(); }

void PostgresDatabase::disconnect() noexcept {
  if (connection_ != nullptr) libpq().finish(std::exchange(connection_, nullptr));
  in_transaction_ = false;
}

void PostgresDatabase::connect() {
  // Whoever asks for a pose waits for no host that does not answer: the watch alone does.
  if (watch_.is_away()) throw StateAway(name(), "it does not answer");
  if (steady_clock::now() < try_again_) throw StateAway(name(), away_because_);
  losses_ = watch_.losses();
  connection_ = connected(address_);
  try {
    if (connection_ == nullptr) throw StateAway(name(), "no memory");
    if (libpq().status(connection_) != CONNECTION_OK)
      throw StateAway(name(), one_line(libpq().error(connection_)));
    libpq().on_notice(connection_, &PostgresDatabase::note, this);
    execute(kSession);
  } catch (const maps::StorageError& error) {
    away_because_ = std::string(error.what()).substr(name().size() + 2);
    try_again_ = steady_clock::now() + kTryAgain;
    disconnect();
    throw;
  }
}

void PostgresDatabase::note(void* self, const PGresult* notice) {
  // Somebody has ended the wait of a commit. The text is in the language of the server.
  const char* const from = libpq().error_field(notice, PG_DIAG_SOURCE_FUNCTION);
  if (from != nullptr && std::strcmp(from, "SyncRepWaitForLSN") == 0)
    static_cast<PostgresDatabase*>(self)->not_replicated_ = true;
}

void PostgresDatabase::check(PGresult* result) {
  const ExecStatusType status = libpq().result_status(result);
  if (status == PGRES_COMMAND_OK || status == PGRES_TUPLES_OK) return;
  const char* const code =
      result == nullptr ? nullptr : libpq().error_field(result, PG_DIAG_SQLSTATE);
  const std::string_view state = code == nullptr ? "" : code;
  const std::string reason =
      one_line(result == nullptr ? libpq().error(connection_) : libpq().result_error(result));
  // What the server says has a code; what libpq says by itself is that the connection is gone.
  const bool is_lost = state.empty() || libpq().status(connection_) != CONNECTION_OK;
  // It has become a standby, is shutting down, or what was under way took too long.
  const bool is_away = state == "25006" || state.starts_with("57") || state.starts_with("08") ||
                       state.starts_with("53") || state == "55P03" || state == "25P03";
  if (is_lost || state == "25006") disconnect();
  if (is_lost || is_away) throw StateAway(name(), reason);
  throw maps::StorageError(name(), reason);
}

PostgresDatabase::Result PostgresDatabase::answer(const std::function<int()>& send,
                                                  milliseconds longest) {
  // What watches PostgreSQL finds sooner that it hangs.
  const auto is_lost = [&] { return watch_.losses() != losses_; };
  Result result = exec_within(connection_, longest, is_lost, send);
  if (result == nullptr && libpq().status(connection_) == CONNECTION_OK) {
    const std::string reason =
        is_lost() ? "it does not answer"
                  : "no answer within " + std::to_string(longest.count() / 1000) + " s";
    disconnect();
    throw StateAway(name(), reason);
  }
  check(result.get());
  return result;
}

PostgresDatabase::Result PostgresDatabase::send(const std::string& sql,
                                                const std::vector<Value>& values,
                                                milliseconds longest) {
  if (connection_ == nullptr) connect();
  std::vector<Oid> types;
  std::vector<const char*> texts;
  for (const Value& value : values) {
    types.push_back(value.type);
    texts.push_back(value.text ? value.text->c_str() : nullptr);
  }
  Result result = answer(
      [&] {
        return libpq().send_params(connection_, sql.c_str(), static_cast<int>(values.size()),
                                   types.data(), texts.data(), nullptr, nullptr, 0);
      },
      longest);
  changes_ = std::strtoll(libpq().changed(result.get()), nullptr, 10);
  return result;
}

PostgresDatabase::Result PostgresDatabase::run(const std::string& sql,
                                               const std::vector<Value>& values) {
  if (in_transaction_) return send(sql, values, kLongestAnswer);
  // The watch has another host now, or one that was started again.
  if (watch_.losses() != losses_) disconnect();
  // A connection that lay idle may be gone, and its host no primary any more. What is outside of a
  // transaction only reads.
  const bool was_connected = connection_ != nullptr;
  try {
    return send(sql, values, kLongestAnswer);
  } catch (const StateAway&) {
    if (!was_connected || connection_ != nullptr) throw;
  }
  return send(sql, values, kLongestAnswer);
}

void PostgresDatabase::execute(const std::string& sql) {
  if (connection_ == nullptr) connect();
  answer([&] { return libpq().send_query(connection_, sql.c_str()); }, kLongestAnswer);
}

std::unique_ptr<EngineStatement> PostgresDatabase::prepare(std::string_view sql) {
  return std::make_unique<PostgresStatement>(*this, sql);
}

std::int64_t PostgresDatabase::last_id(std::string_view table) {
  Statement row(*this, "SELECT last FROM given_ids WHERE name = ?");
  return row.bind(table).step() ? row.integer(0) : 0;
}

void PostgresDatabase::set_last_id(std::string_view table, std::int64_t id) {
  Statement(*this, "UPDATE given_ids SET last = ? WHERE name = ?").bind(id).bind(table).step();
}

void PostgresDatabase::begin_writing() {
  run("BEGIN", {});
  in_transaction_ = true;
  try {
    lock_to_write();
  } catch (...) {
    roll_back();
    throw;
  }
}

void PostgresDatabase::lock_to_write() {
  // First: a commit that waits for the standby holds the lock.
  if (libpq().rows(send(kStandbyIsAway, {}, kLongestAnswer).get()) > 0)
    throw StateAway(name(), "its synchronous standby is away: start it, or ask again later");
  send(kLockToWrite, {}, kLongestAnswer);
}

std::int64_t PostgresDatabase::lock_packages() {
  // In one transaction: a connection that was made again in between would not have the lock.
  run("BEGIN", {});
  in_transaction_ = true;
  try {
    execute("SET LOCAL statement_timeout TO '60s'; SET LOCAL lock_timeout TO '60s'");
    send(kLockOfPackages, {}, kLongestWaitForPackages);
    execute("SET LOCAL statement_timeout TO '10s'; SET LOCAL lock_timeout TO '10s'");
    lock_to_write();
    Statement holder(*this, kCountHolder);
    holder.bind(kHolderOfPackages).step();
    commit();
    return holder.integer(0);
  } catch (...) {
    roll_back();
    throw;
  }
}

void PostgresDatabase::begin_reading() {
  run("BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY", {});
  in_transaction_ = true;
}

void PostgresDatabase::commit() {
  // Sent with the commit, to all who listen.
  send(kTellAll, {}, kLongestAnswer);
  not_replicated_ = false;
  const Result result = send("COMMIT", {}, kLongestCommit);
  in_transaction_ = false;
  watch_.bump();
  if (std::strcmp(libpq().command(result.get()), "COMMIT") != 0)
    throw maps::StorageError(name(), "the change was undone");
  if (not_replicated_)
    throw StateAway(name(),
                    "the change is not on the synchronous standby, which is away: start it, or ask "
                    "again later");
}

void PostgresDatabase::roll_back() noexcept {
  if (!std::exchange(in_transaction_, false) || connection_ == nullptr) return;
  try {
    execute("ROLLBACK");
  } catch (const maps::StorageError&) {
    disconnect();
  }
}

PostgresWatch::PostgresWatch(const PostgresAddress& address)
    : address_(address), thread_([this](const std::stop_token& stop) { watch(stop); }) {}

void PostgresWatch::watch(const std::stop_token& stop) {
  const Libpq& pq = libpq();
  struct Finish {
    void operator()(PGconn* connection) const { libpq().finish(connection); }
  };
  std::unique_ptr<PGconn, Finish> connection;
  std::string seen;
  const auto ask = [&](const char* sql) {
    return exec_within(
        connection.get(), kLongestAnswerToWatch, [&] { return stop.stop_requested(); },
        [&] { return pq.send_query(connection.get(), sql); });
  };
  const auto listens = [&] {
    const PostgresDatabase::Result result = ask("LISTEN stillmap");
    return pq.result_status(result.get()) == PGRES_COMMAND_OK;
  };
  const auto lose = [&] {
    connection.reset();
    ++losses_;
  };
  /// @return whether there was an answer.
  const auto look = [&] {
    const PostgresDatabase::Result result = ask("SELECT n FROM stillmap.changes");
    if (result == nullptr) return false;
    if (pq.rows(result.get()) != 1) return true;
    heard_at_ = steady_clock::now();
    std::string now = pq.value(result.get(), 0, 0);
    if (std::exchange(seen, now) != now) ++mark_;
    return true;
  };
  while (!stop.stop_requested()) {
    if (connection == nullptr) {
      connection.reset(connected(address_));
      if (pq.status(connection.get()) != CONNECTION_OK || !listens()) {
        connection.reset();
        is_away_ = true;
        std::this_thread::sleep_for(kTryAgain);
        continue;
      }
      // What came while nobody listened.
      is_away_ = false;
      heard_at_ = steady_clock::now();
      ++mark_;
    }
    pollfd waiting{pq.socket(connection.get()), POLLIN, 0};
    const int ready = ::poll(&waiting, 1, static_cast<int>(kLookEvery.count()));
    // Finds also that the host is gone or hangs, which says nothing by itself.
    if (ready == 0 && !look() && pq.status(connection.get()) == CONNECTION_OK) {
      is_away_ = true;
      lose();
      continue;
    }
    if (pq.consume(connection.get()) == 0 || pq.status(connection.get()) != CONNECTION_OK) {
      lose();
      continue;
    }
    while (PGnotify* const told = pq.notification(connection.get())) {
      pq.free(told);
      heard_at_ = steady_clock::now();
      ++mark_;
    }
  }
}

}  // namespace stillmap::server

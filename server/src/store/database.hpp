#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::server {

/// What an engine does for one `Statement`. Parameters count from 1, columns from 0.
class EngineStatement {
 public:
  EngineStatement() = default;
  virtual ~EngineStatement() = default;
  EngineStatement(const EngineStatement&) = delete;
  EngineStatement& operator=(const EngineStatement&) = delete;
  virtual void bind_text(int parameter, const std::optional<std::string_view>& text) = 0;
  virtual void bind_integer(int parameter, const std::optional<std::int64_t>& number) = 0;
  virtual void bind_real(int parameter, double number) = 0;
  virtual bool step() = 0;
  [[nodiscard]] virtual std::optional<std::string> text(int column) const = 0;
  [[nodiscard]] virtual std::optional<std::int64_t> integer(int column) const = 0;
  [[nodiscard]] virtual double real(int column) const = 0;
};

/// One connection to the database that holds a store's state, for one thread at a time. Statements
/// are written so that every engine reads them alike. Everything throws StorageError with the
/// database's name and the engine's reason; what was under way is then undone, but for a commit
/// whose outcome is not known.
class Database {
 public:
  Database() = default;
  virtual ~Database() = default;
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  /// The file or address, without a password.
  [[nodiscard]] virtual const std::string& name() const = 0;
  /// Runs statements without parameters or rows.
  virtual void execute(const std::string& sql) = 0;
  [[nodiscard]] virtual std::unique_ptr<EngineStatement> prepare(std::string_view sql) = 0;
  /// Rows that the latest statement changed.
  [[nodiscard]] virtual std::int64_t changes() const = 0;
  /// Another one after every commit of another connection.
  [[nodiscard]] virtual std::int64_t change_mark() = 0;
  /// The greatest id that a table whose ids are never given twice has given; 0 when none.
  [[nodiscard]] virtual std::int64_t last_id(std::string_view table) = 0;
  /// The next one comes after it.
  virtual void set_last_id(std::string_view table, std::int64_t id) = 0;

  /// Waits until no other connection to this state is writing.
  virtual void begin_writing() = 0;
  /// All that is read until the end is of one instant.
  virtual void begin_reading() = 0;
  virtual void commit() = 0;
  /// Ends what was begun, if it is under way still.
  virtual void roll_back() noexcept = 0;
};

/// One statement with its parameters bound in order from 1.
class Statement {
 public:
  Statement(Database& database, std::string_view sql) : engine_(database.prepare(sql)) {}

  Statement& bind(std::string_view text) {
    engine_->bind_text(++bound_, text);
    return *this;
  }
  Statement& bind(const std::string& text) { return bind(std::string_view(text)); }
  Statement& bind(const char* text) { return bind(std::string_view(text)); }
  Statement& bind(const std::optional<std::string>& text) {
    engine_->bind_text(++bound_, text);
    return *this;
  }
  Statement& bind(std::int64_t number) {
    engine_->bind_integer(++bound_, number);
    return *this;
  }
  Statement& bind(const std::optional<std::int64_t>& number) {
    engine_->bind_integer(++bound_, number);
    return *this;
  }
  Statement& bind_real(double number) {
    engine_->bind_real(++bound_, number);
    return *this;
  }
  /// @return whether there is a row.
  bool step() { return engine_->step(); }
  /// Columns from 0. Without a value: empty text, 0.
  [[nodiscard]] std::string text(int column) const {
    return engine_->text(column).value_or(std::string());
  }
  [[nodiscard]] std::optional<std::string> optional_text(int column) const {
    return engine_->text(column);
  }
  [[nodiscard]] std::int64_t integer(int column) const {
    return engine_->integer(column).value_or(0);
  }
  [[nodiscard]] std::optional<std::int64_t> optional_integer(int column) const {
    return engine_->integer(column);
  }
  [[nodiscard]] double real(int column) const { return engine_->real(column); }

 private:
  std::unique_ptr<EngineStatement> engine_;
  int bound_ = 0;
};

/// What is not committed is undone.
class Transaction {
 public:
  enum class For : std::uint8_t { kWriting, kReading };
  explicit Transaction(Database& database, For what = For::kWriting) : database_(database) {
    if (what == For::kWriting)
      database.begin_writing();
    else
      database.begin_reading();
  }
  ~Transaction() { database_.roll_back(); }
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  void commit() { database_.commit(); }

 private:
  Database& database_;
};

}  // namespace stillmap::server

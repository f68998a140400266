#include "bags/rosbag2_database.hpp"

#include <sqlite3.h>

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <string_view>
#include <system_error>
#include <utility>

#include "bags/byte_stream.hpp"
#include "formats/file_reader.hpp"

namespace stillmap::maps {
namespace {

constexpr int kLatestSchema = 4;
constexpr std::size_t kMostTopics = 4096;
constexpr int kMostNameBytes = 1024;
constexpr std::array<std::byte, 4> kZstdMagic{std::byte{0x28}, std::byte{0xB5}, std::byte{0x2F},
                                              std::byte{0xFD}};

/// A row is of ten bytes at least and takes ten steps of SQLite's virtual machine; trees whose
/// pages have several ways to each other would take years.
constexpr int kStepsAtOnce = 1000;
constexpr std::uint64_t kStepsPerByte = 4;
constexpr std::uint64_t kLeastSteps = 1'000'000;

/// Rows in the order in which they were written, without their bytes.
constexpr const char* kRows = "SELECT rowid, topic_id, timestamp FROM messages ORDER BY rowid";

/// CDR begins with 0.
bool is_packed(std::span<const std::byte> head) {
  return head.size() >= kZstdMagic.size() &&
         std::equal(kZstdMagic.begin(), kZstdMagic.end(), head.begin());
}

/// Lets statements read the tables of a bag and do nothing else; what views, triggers and generated
/// columns of the file would do is asked for here as well.
int allow(void* /*self*/, int action, const char* first, const char* /*second*/,
          const char* /*database*/, const char* inner) {
  if (action == SQLITE_SELECT) return SQLITE_OK;
  if (action != SQLITE_READ || first == nullptr || inner != nullptr) return SQLITE_DENY;
  const std::string_view table = first;
  const bool known = table == "topics" || table == "messages" || table == "schema" ||
                     table == "sqlite_master" || table == "sqlite_schema";
  return known ? SQLITE_OK : SQLITE_DENY;
}

/// @return what ends the statement, unless 0.
int count_down(void* left) { return --*static_cast<std::int64_t*>(left) < 0 ? 1 : 0; }

std::string text_of(sqlite3_stmt& row, int column) {
  const int size = sqlite3_column_bytes(&row, column);
  const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(&row, column));
  if (text == nullptr || size > kMostNameBytes) return {};
  return {text, static_cast<std::size_t>(size)};
}

/// What the head of a database says of its length, where it can be believed (SQLite file format,
/// 1.3.8); else 0.
std::uint64_t promised_bytes(const std::filesystem::path& file) {
  std::array<std::byte, 100> head{};
  if (FileReader(file).read_at(0, head) < head.size()) return 0;
  const auto number = [&](std::size_t offset, std::size_t size) {
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < size; ++i)
      value = value << 8U | std::to_integer<std::uint64_t>(head.at(offset + i));
    return value;
  };
  if (number(24, 4) != number(92, 4)) return 0;
  const std::uint64_t page_bytes = number(16, 2) == 1 ? 65536 : number(16, 2);
  return page_bytes * number(28, 4);
}

/// @return 0 where there is none.
std::uint64_t log_bytes(const std::filesystem::path& file) {
  std::error_code error;
  const std::uint64_t size = std::filesystem::file_size(file.string() + "-wal", error);
  return error ? 0 : size;
}

/// "file:" and the path, as SQLite reads an URI.
std::string uri_of(const std::filesystem::path& file) {
  std::string uri = "file:";
  for (const char letter : std::filesystem::absolute(file).string()) {
    if (letter == '?' || letter == '#' || letter == '%') {
      uri += fmt::format("%{:02X}", static_cast<unsigned char>(letter));
    } else {
      uri += letter;
    }
  }
  return uri;
}

}  // namespace

void Rosbag2Database::Close::operator()(sqlite3* connection) const { sqlite3_close(connection); }
void Rosbag2Database::Finalize::operator()(sqlite3_stmt* statement) const {
  sqlite3_finalize(statement);
}

/// The bytes of `data` of one row after the other, read where they lie.
class Rosbag2Database::Blob {
 public:
  explicit Blob(const Rosbag2Database& bag) : bag_(&bag) {}
  ~Blob() { sqlite3_blob_close(blob_); }
  Blob(const Blob&) = delete;
  Blob& operator=(const Blob&) = delete;

  /// @return false when there is no such row or it holds something else.
  bool open(std::int64_t row) {
    if (blob_ != nullptr && sqlite3_blob_reopen(blob_, row) == SQLITE_OK) return true;
    // One that failed to open a row opens none any more.
    sqlite3_blob_close(std::exchange(blob_, nullptr));
    return sqlite3_blob_open(bag_->connection_.get(), "main", "messages", "data", row, 0, &blob_) ==
           SQLITE_OK;
  }
  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(sqlite3_blob_bytes(blob_));
  }
  /// @return false for broken pages. @param into  no more than there is from `offset` on.
  bool read(std::span<std::byte> into, std::size_t offset = 0) {
    return sqlite3_blob_read(blob_, into.data(), static_cast<int>(into.size()),
                             static_cast<int>(offset)) == SQLITE_OK;
  }

 private:
  const Rosbag2Database* bag_;
  sqlite3_blob* blob_ = nullptr;
};

/// The bytes of a blob, of which only those are read that are asked for.
class Rosbag2Database::BlobStream final : public ByteStream {
 public:
  /// @param blob  outlives this.
  explicit BlobStream(Blob& blob) : blob_(&blob) {}
  std::size_t read(std::span<std::byte> into) override {
    into = into.first(std::min(into.size(), blob_->size() - position_));
    if (!into.empty() && !blob_->read(into, position_))
      throw InputError("row", "data that cannot be read", "whole pages");
    position_ += into.size();
    return into.size();
  }

 private:
  Blob* blob_;
  std::size_t position_ = 0;
};

Rosbag2Database::Rosbag2Database(const std::filesystem::path& file,
                                 const std::filesystem::path& shown_as)
    : file_(shown_as.empty() ? file : shown_as) {
  open(file);
  confine();
  const bool has_schema = check_tables();
  sqlite3_set_authorizer(connection_.get(), allow, nullptr);
  if (has_schema) check_schema();
  (void)prepare(kRows);
  read_topics();
}

void Rosbag2Database::open(const std::filesystem::path& file) {
  const std::uint64_t log = log_bytes(file);
  const bool has_log = log > 0;
  // Told that nothing changes, SQLite does not look into a log that is there.
  const std::string uri = uri_of(file) + (has_log ? "?mode=ro" : "?mode=ro&immutable=1");
  sqlite3* connection = nullptr;
  const int code = sqlite3_open_v2(
      uri.c_str(), &connection,
      SQLITE_OPEN_READONLY | SQLITE_OPEN_URI | SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_PRIVATECACHE,
      "unix-none");
  connection_.reset(connection);
  if (code != SQLITE_OK)
    throw StorageError(file_.string(), connection == nullptr ? "no memory" : sqlite3_errstr(code));
  sqlite3_progress_handler(connection, kStepsAtOnce, count_down, &steps_left_);
  if (has_log) add_note("read with " + file.filename().string() + "-wal");
  const std::uint64_t promised = has_log ? 0 : promised_bytes(file);
  const std::uint64_t size = std::filesystem::file_size(file);
  bytes_ = size + log;
  if (promised <= size) return;
  is_cut_off_ = true;
  add_note(fmt::format("the bag is cut off: {} of {} bytes", size, promised));
}

void Rosbag2Database::confine() {
  sqlite3* const connection = connection_.get();
  for (const auto& [option, value] : std::initializer_list<std::pair<int, int>>{
           {SQLITE_DBCONFIG_DEFENSIVE, is_cut_off_ ? 0 : 1},
           // Nothing can be written anyway; it makes SQLite
           // read the pages that are there.
           {SQLITE_DBCONFIG_WRITABLE_SCHEMA, is_cut_off_ ? 1 : 0},
           {SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0},
           {SQLITE_DBCONFIG_ENABLE_TRIGGER, 0},
           {SQLITE_DBCONFIG_ENABLE_VIEW, 0},
           {SQLITE_DBCONFIG_ENABLE_LOAD_EXTENSION, 0},
           {SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1}})
    sqlite3_db_config(connection, option, value, nullptr);
  for (const auto& [limit, value] : std::initializer_list<std::pair<int, int>>{
           {SQLITE_LIMIT_LENGTH, static_cast<int>(kMostMessageBytes) + (1 << 20)},
           {SQLITE_LIMIT_SQL_LENGTH, 1 << 16},
           {SQLITE_LIMIT_COLUMN, 64},
           {SQLITE_LIMIT_EXPR_DEPTH, 16},
           {SQLITE_LIMIT_ATTACHED, 0},
           {SQLITE_LIMIT_TRIGGER_DEPTH, 1},
           {SQLITE_LIMIT_WORKER_THREADS, 0}})
    sqlite3_limit(connection, limit, value);
  // The index of a log is then kept in memory, not beside the file.
  sqlite3_exec(connection,
               "PRAGMA locking_mode=EXCLUSIVE; PRAGMA mmap_size=0; PRAGMA cache_size=-2048;"
               "PRAGMA temp_store=MEMORY; PRAGMA cell_size_check=ON;",
               nullptr, nullptr, nullptr);
}

void Rosbag2Database::refuse(const std::string& what) const {
  const int code = sqlite3_errcode(connection_.get()) & 0xff;
  const std::string reason = sqlite3_errmsg(connection_.get());
  if (code == SQLITE_IOERR || code == SQLITE_CANTOPEN || code == SQLITE_NOMEM)
    throw StorageError(file_.string(), reason);
  throw InputError(
      file_.string(), what + ": " + reason,
      "a SQLite file of rosbag2 with the tables topics and messages: copy the whole bag again");
}

Rosbag2Database::Statement Rosbag2Database::prepare(const char* sql) const {
  steps_left_ =
      static_cast<std::int64_t>(std::max(kLeastSteps, kStepsPerByte * bytes_) / kStepsAtOnce);
  sqlite3_stmt* statement = nullptr;
  if (sqlite3_prepare_v2(connection_.get(), sql, -1, &statement, nullptr) != SQLITE_OK)
    refuse("another database");
  return Statement(statement);
}

bool Rosbag2Database::step(sqlite3_stmt& statement) const {
  const int code = sqlite3_step(&statement);
  if (code != SQLITE_ROW && code != SQLITE_DONE) refuse("a broken database");
  return code == SQLITE_ROW;
}

/// Tables of `CREATE TABLE` whose columns hold what was written: behind others stands code, which
/// the authorizer is not asked about in every case.
/// @return whether there is a table `schema`, as since schema 3.
bool Rosbag2Database::check_tables() const {
  std::vector<std::string> found;
  {
    const Statement tables = prepare(
        "SELECT name, rootpage FROM sqlite_master WHERE type = 'table' AND name IN "
        "('topics', 'messages', 'schema')");
    while (found.size() < 4 && step(*tables))
      if (sqlite3_column_int64(tables.get(), 1) > 0) found.push_back(text_of(*tables, 0));
  }
  const auto has = [&](const char* name) {
    return std::find(found.begin(), found.end(), name) != found.end();
  };
  if (!has("topics") || !has("messages"))
    throw InputError(file_.string(), "a SQLite database without tables topics and messages",
                     "one of rosbag2: check the path");
  for (const std::string& table : found) {
    const std::string sql = "SELECT 1 FROM pragma_table_xinfo('" + table + "') WHERE hidden <> 0";
    if (step(*prepare(sql.c_str())))
      throw InputError(file_.string(), "columns of '" + table + "' that are computed",
                       "a table of rosbag2");
  }
  return has("schema");
}

void Rosbag2Database::check_schema() const {
  const Statement schema = prepare("SELECT schema_version FROM schema");
  while (step(*schema)) {
    const std::int64_t version = sqlite3_column_int64(schema.get(), 0);
    if (version > kLatestSchema)
      throw InputError(
          file_.string(), fmt::format("schema {} of rosbag2", version),
          fmt::format("1 to {}: convert the bag to MCAP (`ros2 bag convert`)", kLatestSchema));
  }
}

void Rosbag2Database::read_topics() {
  const Statement rows = prepare("SELECT id, name, type, serialization_format FROM topics");
  while (step(*rows)) {
    if (topics_.size() >= kMostTopics)
      throw InputError(file_.string(), fmt::format("over {} topics", kMostTopics), "fewer");
    topic_of_id_[sqlite3_column_int64(rows.get(), 0)] = topics_.size();
    topics_.push_back({text_of(*rows, 1), ros2_type(text_of(*rows, 2)),
                       text_of(*rows, 3) == "cdr" ? Serialization::kCdr : Serialization::kOther});
  }
}

std::string Rosbag2Database::take_row(Blob& blob, std::int64_t row, std::size_t wanted,
                                      std::vector<std::byte>& head, std::uint32_t& size) const {
  if (!blob.open(row)) return "its data cannot be read";
  if (blob.size() > kMostMessageBytes)
    return fmt::format("{} bytes, expected at most {}", blob.size(), kMostMessageBytes);
  size = static_cast<std::uint32_t>(blob.size());
  head.resize(std::min(std::max(wanted, kZstdMagic.size()), blob.size()));
  if (!blob.read(head)) return "its data cannot be read";
  if (is_packed(head)) {
    head.resize(wanted);
    head.resize(unpacked(std::make_unique<BlobStream>(blob), "zstd", "row")->read(head));
  }
  head.resize(std::min(wanted, head.size()));
  return {};
}

BagDamage Rosbag2Database::visit(std::span<const std::size_t> head_bytes, const Take& take) const {
  const std::scoped_lock lock(mutex_);
  BagDamage damage;
  const Statement rows = prepare(kRows);
  Blob blob(*this);
  std::vector<std::byte> head;
  std::optional<std::int64_t> last;
  while (sqlite3_step(rows.get()) == SQLITE_ROW) {
    const std::int64_t row = sqlite3_column_int64(rows.get(), 0);
    if (last && row <= *last) {
      damage.add(fmt::format("rows that go in circles behind {}", *last));
      return damage;
    }
    last = row;
    const auto topic = topic_of_id_.find(sqlite3_column_int64(rows.get(), 1));
    const std::size_t wanted = topic == topic_of_id_.end() ? 0 : head_bytes[topic->second];
    if (wanted == 0) continue;
    std::uint32_t size = 0;
    std::string trouble;
    try {
      trouble = take_row(blob, row, wanted, head, size);
    } catch (const InputError& error) {
      trouble = error.what();
    }
    if (trouble.empty()) {
      take({topic->second,
            {0, static_cast<std::uint64_t>(row), size},
            sqlite3_column_int64(rows.get(), 2),
            head});
    } else {
      damage.add(fmt::format("row {}: {}", row, trouble));
    }
  }
  if (sqlite3_errcode(connection_.get()) != SQLITE_DONE)
    damage.add(
        fmt::format("behind row {}: {}", last.value_or(0), sqlite3_errmsg(connection_.get())));
  return damage;
}

FileBytes Rosbag2Database::read(const MessagePlace& place) const {
  const auto row = static_cast<std::int64_t>(place.inner);
  auto bytes = std::make_unique_for_overwrite<std::byte[]>(place.size);
  const std::span<std::byte> all(bytes.get(), place.size);
  {
    const std::scoped_lock lock(mutex_);
    Blob blob(*this);
    if (!blob.open(row) || blob.size() != all.size() || !blob.read(all))
      throw InputError(file_.string(), fmt::format("no message in row {}", row),
                       fmt::format("one of {} bytes", place.size));
  }
  if (!is_packed(all)) return {std::move(bytes), all.size()};
  // Once for its length, which nothing trustworthy tells.
  const std::string name = fmt::format("{} row {}", file_.string(), row);
  const auto stream = [&] { return unpacked(std::make_unique<MemoryStream>(all), "zstd", name); };
  const std::uint64_t length = stream()->skip(kMostMessageBytes + 1);
  if (length > kMostMessageBytes)
    throw InputError(name, "a longer message", fmt::format("at most {} bytes", kMostMessageBytes));
  auto message = std::make_unique_for_overwrite<std::byte[]>(static_cast<std::size_t>(length));
  const std::size_t size = static_cast<std::size_t>(length);
  (void)stream()->read({message.get(), size});
  return {std::move(message), size};
}

}  // namespace stillmap::maps

#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "bags/bag.hpp"

struct sqlite3;
struct sqlite3_stmt;

namespace stillmap::maps {

/// A SQLite file of rosbag2, schemas 1 to 4: tables `topics` and `messages`. Opened for reading
/// alone, without a lock and with nothing made beside it; a log (`-wal`) that a killed recorder
/// left is read too. Messages packed one by one with zstd are told by their first bytes.
///
/// Nothing of the file is run: no view, trigger, virtual table or function is allowed, and nothing
/// but these tables may be read. A row's bytes are read where they lie, so that memory stays below
/// some megabytes and the message that is asked for. Pages that point to each other over and over
/// are read no longer than a whole file of that size would be.
class Rosbag2Database final : public Bag {
 public:
  /// @throws InputError for a file that is no such database or of a later schema; StorageError.
  /// @param shown_as  what it is called, where that is another.
  explicit Rosbag2Database(const std::filesystem::path& file,
                           const std::filesystem::path& shown_as = {});

  [[nodiscard]] BagFormat format() const override { return BagFormat::kSqlite; }
  [[nodiscard]] const std::filesystem::path& file() const override { return file_; }
  [[nodiscard]] const std::vector<BagTopic>& topics() const override { return topics_; }
  BagDamage visit(std::span<const std::size_t> head_bytes, const Take& take) const override;
  [[nodiscard]] FileBytes read(const MessagePlace& place) const override;

 private:
  struct Close {
    void operator()(sqlite3* connection) const;
  };
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const;
  };
  using Statement = std::unique_ptr<sqlite3_stmt, Finalize>;
  class Blob;
  class BlobStream;

  void open(const std::filesystem::path& file);
  void confine();
  [[nodiscard]] bool check_tables() const;
  void check_schema() const;
  void read_topics();
  [[nodiscard]] Statement prepare(const char* sql) const;
  [[nodiscard]] bool step(sqlite3_stmt& statement) const;
  /// @return what is wrong with a row; empty when nothing is.
  [[nodiscard]] std::string take_row(Blob& blob, std::int64_t row, std::size_t wanted,
                                     std::vector<std::byte>& head, std::uint32_t& size) const;
  [[noreturn]] void refuse(const std::string& what) const;

  std::filesystem::path file_;
  std::vector<BagTopic> topics_;
  std::map<std::int64_t, std::size_t> topic_of_id_;
  bool is_cut_off_ = false;
  /// Of the database and its log.
  std::uint64_t bytes_ = 0;
  /// Of SQLite's virtual machine, in thousands, that the statement at hand may still take.
  mutable std::int64_t steps_left_ = 0;
  /// SQLite's connection is for one thread at a time.
  mutable std::mutex mutex_;
  std::unique_ptr<sqlite3, Close> connection_;
};

}  // namespace stillmap::maps

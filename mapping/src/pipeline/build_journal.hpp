#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// What one stage of a build has done so far, record by record on the disk, so that a build that is
/// killed need not do it again.
///
/// A journal belongs to its key, the text of everything that decides the stage's result: one of
/// another key is thrown away when it is opened, never read. Every record carries a checksum over
/// its bytes, its place, the stage and the key; the first one that does not fit ends the journal.
/// A kill loses no record, a power cut those of the last seconds. For the same program on machines
/// alike; memory holds 8 bytes a record. Not a maps::SectionTable: that one is written at the
/// end.
class BuildJournal {
 public:
  enum class Use : std::uint8_t {
    kWrite,     ///< By one process at a time.
    kContinue,  ///< The same, but one of another key is left as it is, which is an error.
    kRead,      ///< By any number, once it is complete. Its file stays as it is.
  };
  /// Opens what a killed build left, or begins. A journal that is read is empty, and `discarded`
  /// says why, when it is not there, not complete, or of another key.
  /// @param folder  made if missing; the journal is the file `STAGE.journal` in it.
  /// @param key     lines "NAME: VALUE".
  /// @throws maps::StorageError naming the file; maps::InputError as above.
  BuildJournal(const std::filesystem::path& folder, std::string stage, std::string key,
               Use use = Use::kWrite);
  ~BuildJournal();
  BuildJournal(const BuildJournal&) = delete;
  BuildJournal& operator=(const BuildJournal&) = delete;

  /// Records that were found and kept; those appended since do not count.
  [[nodiscard]] std::size_t size() const { return found_.size(); }
  /// Whether all records of the stage were found.
  [[nodiscard]] bool is_complete() const { return complete_; }
  /// Why what was found was thrown away; empty when it was not.
  [[nodiscard]] const std::string& discarded() const { return discarded_; }
  [[nodiscard]] const std::filesystem::path& file() const { return file_; }
  /// For one that is read. @param unit  that writes it, for the message.
  /// @throws maps::InputError when it is not complete.
  void require_complete(std::string_view unit) const;
  /// A record of one that is read. @throws maps::InputError when it is not whole.
  [[nodiscard]] std::string require(std::size_t record, std::string_view unit) const;
  /// Of all records that were found when it was opened: another one when any of them is another.
  /// SHA-256, hex.
  [[nodiscard]] const std::string& sum() const { return sum_; }

  /// @param record  in [0, size()).
  /// @return its bytes; nothing when they are not those that were written.
  /// @note Safe from several threads, also beside `append`.
  /// @throws maps::StorageError naming the file.
  [[nodiscard]] std::optional<std::string> read(std::size_t record) const;
  /// Visits the records in order, one in memory at a time. The first broken one and those behind it
  /// are forgotten, and so are those from the first one on that `visit` refuses with false.
  /// @return records visited and kept.
  std::size_t replay(const std::function<bool(std::string_view bytes)>& visit);
  /// Forgets the records from `size` on, before any is appended.
  void keep(std::size_t size);
  /// Forgets all. @param why  for `discarded`.
  void discard(const std::string& why);

  /// The next record, behind those that were found. From one thread at a time.
  /// @throws std::logic_error after `complete`; maps::StorageError, e.g. on a full disk.
  void append(std::string_view bytes);
  /// No record follows. All are on the disk when it returns.
  void complete();

 private:
  void begin();
  void open_file(const std::filesystem::path& folder);
  void open_found();
  void walk(std::uint64_t bytes);
  void write(std::string_view bytes);
  void write_record(std::uint64_t size_field, const std::string& sum, std::string_view bytes);
  void truncate(std::uint64_t bytes);
  void sync();
  [[nodiscard]] int open_to_read() const;
  [[nodiscard]] bool read_at(std::uint64_t offset, char* bytes, std::size_t size) const;
  /// @param place  ordinal of a record.
  [[nodiscard]] std::string sum_of(std::string_view kind, std::size_t place,
                                   std::string_view bytes) const;

  std::string stage_;
  std::string key_;
  std::string key_sum_;
  std::filesystem::path file_;
  Use use_;
  int descriptor_ = -1;
  /// Where the records begin that were found.
  std::vector<std::uint64_t> found_;
  bool complete_ = false;
  std::string discarded_;
  std::string sum_;
  std::size_t next_ = 0;
  std::uint64_t end_ = 0;
  std::chrono::steady_clock::time_point synced_;
};

}  // namespace stillmap::mapping

#include "pipeline/build_journal.hpp"

#include "pipeline/build_key.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fmt/format.h>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Before a record's bytes: how many there are, and their checksum (SHA-256, hex).
struct Head {
  std::uint64_t size = 0;
  std::array<char, 64> sum{};
};
static_assert(sizeof(Head) == 72);

/// In place of a size: no record follows.
constexpr std::uint64_t kEnd = std::numeric_limits<std::uint64_t>::max();

/// What a power cut may cost. A flush takes a slow disk some tenths of a second.
constexpr std::chrono::seconds kBetweenSyncs{5};

std::string_view text_of(const std::array<char, 64>& sum) { return {sum.data(), sum.size()}; }

/// Where a file ends before its bytes were written, a power cut leaves zeros.
bool is_hex(const std::array<char, 64>& sum) {
  return text_of(sum).find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

}  // namespace

BuildJournal::BuildJournal(const std::filesystem::path& folder, std::string stage, std::string key,
                           Use use)
    : stage_(std::move(stage)),
      key_(std::move(key)),
      key_sum_(maps::sha256_of(key_)),
      file_(folder / (stage_ + ".journal")),
      use_(use),
      synced_(std::chrono::steady_clock::now()) {
  open_file(folder);
  if (descriptor_ < 0) return;
  try {
    open_found();
  } catch (...) {
    ::close(descriptor_);
    throw;
  }
  if (use_ != Use::kRead) return;
  if (!complete_ && discarded_.empty()) discard("it is not complete");
  // A build may have more journals than a process may have open files.
  ::close(std::exchange(descriptor_, -1));
}

int BuildJournal::open_to_read() const {
  return ::open(file_.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
}

void BuildJournal::open_file(const std::filesystem::path& folder) {
  if (use_ == Use::kRead) {
    descriptor_ = open_to_read();
    if (descriptor_ < 0 && errno != ENOENT)
      throw maps::StorageError(file_.string(), std::strerror(errno));
    if (descriptor_ < 0) discarded_ = "it is not there";
    return;
  }
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw maps::StorageError(folder.string(), error.message());
  descriptor_ = ::open(file_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
  if (descriptor_ < 0) throw maps::StorageError(file_.string(), std::strerror(errno));
}

BuildJournal::~BuildJournal() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void BuildJournal::open_found() {
  struct stat status {};
  if (::fstat(descriptor_, &status) != 0)
    throw maps::StorageError(file_.string(), std::strerror(errno));
  const auto bytes = static_cast<std::uint64_t>(status.st_size);
  if (bytes == 0 && use_ != Use::kRead) return begin();
  Head head;
  std::string key;
  bool whole = bytes >= sizeof head && read_at(0, reinterpret_cast<char*>(&head), sizeof head) &&
               head.size <= bytes - sizeof head;
  if (whole) {
    key.resize(head.size);
    whole =
        read_at(sizeof head, key.data(), key.size()) && maps::sha256_of(key) == text_of(head.sum);
  }
  if (!whole) return discard("its head is damaged");
  if (key != key_ && use_ == Use::kContinue)
    throw maps::InputError(file_.string(),
                           "the work of another build: " + key_difference(key, key_),
                           fmt::format("the same program, options, drives and a machine alike; to "
                                       "begin anew, remove {}",
                                       file_.parent_path().string()));
  if (key != key_) return discard(key_difference(key, key_));
  end_ = sizeof head + key.size();
  walk(bytes);
}

void BuildJournal::walk(std::uint64_t bytes) {
  while (!complete_ && bytes - end_ >= sizeof(Head)) {
    Head head;
    if (!read_at(end_, reinterpret_cast<char*>(&head), sizeof head) || !is_hex(head.sum)) break;
    const std::uint64_t left = bytes - end_ - sizeof head;
    if (head.size == kEnd) {
      complete_ = text_of(head.sum) == sum_of("end", found_.size(), {});
      if (!complete_) break;
      end_ += sizeof head;
    } else {
      if (head.size > left) break;
      found_.push_back(end_);
      sum_ = maps::sha256_of(sum_ + std::string(text_of(head.sum)));
      end_ += sizeof head + head.size;
    }
  }
  next_ = found_.size();
  if (end_ != bytes && use_ != Use::kRead) truncate(end_);
}

void BuildJournal::begin() {
  truncate(0);
  write_record(key_.size(), key_sum_, key_);
  sync();
  // Otherwise a power cut may take the name of a file whose bytes are safe.
  const int folder = ::open(file_.parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder < 0) throw maps::StorageError(file_.parent_path().string(), std::strerror(errno));
  ::fsync(folder);
  ::close(folder);
}

void BuildJournal::discard(const std::string& why) {
  discarded_ = why;
  found_.clear();
  complete_ = false;
  next_ = 0;
  if (use_ != Use::kRead) begin();
}

void BuildJournal::require_complete(std::string_view unit) const {
  if (complete_) return;
  throw maps::InputError(
      file_.string(), fmt::format("no finished work of this build ({})", discarded_),
      fmt::format("what the unit '{0}' writes: do --unit {0} first, with the same program and "
                  "options, on a machine alike",
                  unit));
}

std::string BuildJournal::require(std::size_t record, std::string_view unit) const {
  require_complete(unit);
  auto bytes = record < size() ? read(record) : std::nullopt;
  if (bytes) return *std::move(bytes);
  throw maps::InputError(
      file_.string(), fmt::format("broken bytes in record {}", record),
      fmt::format("what the unit '{0}' wrote: remove the file and do --unit {0} again", unit));
}

std::string BuildJournal::sum_of(std::string_view kind, std::size_t place,
                                 std::string_view bytes) const {
  return maps::sha256_of(
      fmt::format("{} {} {} {} {}", key_sum_, stage_, kind, place, maps::sha256_of(bytes)));
}

bool BuildJournal::read_at(std::uint64_t offset, char* bytes, std::size_t size) const {
  const bool is_open = descriptor_ >= 0;
  const int descriptor = is_open ? descriptor_ : open_to_read();
  if (descriptor < 0) throw maps::StorageError(file_.string(), std::strerror(errno));
  std::size_t done = 0;
  int failed = 0;
  while (done < size && failed == 0) {
    const ssize_t got =
        ::pread(descriptor, bytes + done, size - done, static_cast<off_t>(offset + done));
    if (got == 0) break;
    if (got > 0) done += static_cast<std::size_t>(got);
    if (got < 0 && errno != EINTR) failed = errno;
  }
  if (!is_open) ::close(descriptor);
  if (failed != 0) throw maps::StorageError(file_.string(), std::strerror(failed));
  return done == size;
}

std::optional<std::string> BuildJournal::read(std::size_t record) const {
  const std::uint64_t at = found_.at(record);
  Head head;
  if (!read_at(at, reinterpret_cast<char*>(&head), sizeof head)) return std::nullopt;
  // The place of the next one was found by this size: another one now is not what was written.
  const std::uint64_t most = (record + 1 < found_.size() ? found_[record + 1] : end_) - at;
  if (head.size > most) return std::nullopt;
  std::string bytes(head.size, '\0');
  if (!read_at(at + sizeof head, bytes.data(), bytes.size())) return std::nullopt;
  if (text_of(head.sum) != sum_of("record", record, bytes)) return std::nullopt;
  return bytes;
}

std::size_t BuildJournal::replay(const std::function<bool(std::string_view bytes)>& visit) {
  for (std::size_t record = 0; record < found_.size(); ++record) {
    const std::optional<std::string> bytes = read(record);
    if (!bytes || !visit(*bytes)) keep(record);
  }
  return found_.size();
}

void BuildJournal::keep(std::size_t size) {
  if (size >= found_.size()) return;
  truncate(found_[size]);
  found_.resize(size);
  complete_ = false;
  next_ = size;
}

void BuildJournal::append(std::string_view bytes) {
  if (complete_) throw std::logic_error("journal: a record after the last");
  write_record(bytes.size(), sum_of("record", next_, bytes), bytes);
  ++next_;
  if (std::chrono::steady_clock::now() - synced_ > kBetweenSyncs) sync();
}

void BuildJournal::complete() {
  if (complete_) return;
  write_record(kEnd, sum_of("end", next_, {}), {});
  complete_ = true;
  sync();
}

void BuildJournal::write_record(std::uint64_t size_field, const std::string& sum,
                                std::string_view bytes) {
  Head head{.size = size_field};
  std::copy(sum.begin(), sum.end(), head.sum.begin());
  write({reinterpret_cast<const char*>(&head), sizeof head});
  write(bytes);
}

void BuildJournal::write(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written =
        ::pwrite(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(end_));
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) throw maps::StorageError(file_.string(), std::strerror(errno));
    if (written == 0) throw maps::StorageError(file_.string(), "nothing could be written");
    end_ += static_cast<std::uint64_t>(written);
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

void BuildJournal::truncate(std::uint64_t bytes) {
  if (::ftruncate(descriptor_, static_cast<off_t>(bytes)) != 0)
    throw maps::StorageError(file_.string(), std::strerror(errno));
  end_ = bytes;
}

void BuildJournal::sync() {
  if (::fdatasync(descriptor_) != 0) throw maps::StorageError(file_.string(), std::strerror(errno));
  synced_ = std::chrono::steady_clock::now();
}

}  // namespace stillmap::mapping

#include "store/tar_reader.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <utility>

#include <stillmap/maps/text.hpp>
#include "store/archive_path.hpp"
#include "store/tar_header.hpp"

namespace stillmap::server {
namespace {

constexpr const char* kExpectedTar = "files and folders of a tar";

ArchiveReader new_tar_reader() {
  ArchiveReader reader(archive_read_new());
  if (!reader || archive_read_support_format_tar(reader.get()) != ARCHIVE_OK)
    throw std::runtime_error("libarchive without tar");
  return reader;
}

/// What an entry of this type would be; nothing for a file or a folder.
const char* refused_type(char type) {
  switch (type) {
    case '0':
    case '\0':
    case '5':
      return nullptr;
    case '1':
      return "a hard link";
    case '2':
    case 'K':
      return "a link";
    case '3':
    case '4':
      return "a device";
    case '6':
      return "a pipe";
    case 'S':
      return "a sparse file";
    default:
      return "an unknown type of entry";
  }
}

bool is_special(char type) { return type == 'x' || type == 'g' || type == 'L'; }

/// Refuses what pax records would make of a file beyond a name and a size.
void check_records(std::string_view records, const std::string& place) {
  while (!records.empty()) {
    // "LENGTH KEY=VALUE\n", the length of all of it.
    const std::size_t blank = std::min(records.find(' '), records.size());
    const auto length = maps::parse_count(records.substr(0, blank));
    if (!length || *length <= blank || *length > records.size())
      throw maps::InputError(place, "a broken pax header", kExpectedTar);
    const std::string_view record = records.substr(blank + 1, *length - blank - 1);
    const std::string_view key = record.substr(0, record.find('='));
    if (key == "linkpath") throw maps::InputError(place, "a link", kExpectedTar);
    if (key.starts_with("GNU.sparse.") || key == "SCHILY.realsize" || key == "SUN.holesdata")
      throw maps::InputError(place, "a sparse file", kExpectedTar);
    records.remove_prefix(*length);
  }
}

/// Of an octal number in a header; nothing for anything else.
std::optional<std::uint64_t> octal(std::string_view field) {
  const std::size_t from = std::min(field.find_first_not_of(' '), field.size());
  const std::size_t to = std::min(field.find_first_not_of("01234567", from), field.size());
  if (from == to || field.find_first_not_of(std::string_view(" \0", 2), to) != field.npos)
    return {};
  std::uint64_t number = 0;
  for (const char digit : field.substr(from, to - from))
    number = number * 8 + static_cast<std::uint64_t>(digit - '0');
  return number;
}

}  // namespace

TarReader::TarReader(Unpacker& unpacker, std::string name, const ArchiveLimits& limits)
    : unpacker_(&unpacker),
      name_(std::move(name)),
      limits_(&limits),
      place_(name_),
      reader_(new_tar_reader()) {
  check(archive_read_open(reader_.get(), this, nullptr, &TarReader::give_for, nullptr), place_);
}

std::string TarReader::place(std::string_view path) const {
  return name_ + ": entry '" + shown_path(path) + "'";
}

la_ssize_t TarReader::give_for(archive* reader, void* self, const void** bytes) {
  auto& tar = *static_cast<TarReader*>(self);
  try {
    const std::string_view piece = tar.give();
    *bytes = piece.data();
    return static_cast<la_ssize_t>(piece.size());
  } catch (...) {
    tar.thrown_ = std::current_exception();
    archive_set_error(reader, EIO, "source failed");
    return -1;
  }
}

std::string_view TarReader::give() {
  if (!in_header_) {
    if (padded_left_ == 0)
      throw maps::InputError(place_, "fewer bytes than its headers say", "as many");
    const std::string_view piece = take(padded_left_);
    padded_left_ -= piece.size();
    return piece;
  }
  // A path and an owner take two blocks; libarchive takes the square of the time for some
  // attributes.
  constexpr std::size_t kMostHeaderBytes = 16 * kTarBlock;
  const std::string_view block = take_block();
  headers_.append(block);
  if (headers_.size() > kMostHeaderBytes)
    throw maps::InputError(name_, "headers of an entry beyond 8 KiB", "a path and little more");
  return block;
}

std::string_view TarReader::take(std::uint64_t most) {
  if (piece_.empty()) piece_ = unpacker_->next();
  const std::string_view taken = piece_.substr(0, std::min<std::uint64_t>(most, piece_.size()));
  piece_.remove_prefix(taken.size());
  return taken;
}

std::string_view TarReader::take_block() {
  std::size_t filled = 0;
  while (filled < block_.size()) {
    const std::string_view taken = take(block_.size() - filled);
    if (taken.empty()) break;
    std::copy(taken.begin(), taken.end(), block_.begin() + static_cast<std::ptrdiff_t>(filled));
    filled += taken.size();
  }
  return {block_.data(), filled};
}

void TarReader::check(int result, const std::string& place) {
  if (thrown_) std::rethrow_exception(std::exchange(thrown_, nullptr));
  if (result == ARCHIVE_OK) return;
  const char* reason = archive_error_string(reader_.get());
  // An owner's name beyond the locale's letters; paths are held to ASCII anyway.
  if (result == ARCHIVE_WARN && reason && std::strstr(reason, "to current locale")) return;
  throw maps::InputError(place, reason ? reason : "damage", kExpectedTar);
}

std::optional<TarEntry> TarReader::next() {
  if (!in_header_ && (left_ > 0 || padded_left_ > 0))
    throw std::logic_error("an entry of an archive that was not read to its end");
  in_header_ = true;
  place_ = name_;
  archive_entry* entry = nullptr;
  const int result = archive_read_next_header(reader_.get(), &entry);
  if (result == ARCHIVE_EOF) {
    check(ARCHIVE_OK, place_);
    check_end();
    return {};
  }
  check(result, place_);
  TarEntry found = checked(entry);
  headers_.clear();
  in_header_ = false;
  left_ = found.bytes;
  padded_left_ = in_tar_blocks(found.bytes);
  return found;
}

TarEntry TarReader::checked(archive_entry* entry) {
  const char* path = archive_entry_pathname(entry);
  if (!path) throw maps::InputError(name_, "an entry without a name", kExpectedTar);
  place_ = place(path);
  check_headers(place_);
  if (archive_entry_hardlink(entry) || archive_entry_symlink(entry))
    throw maps::InputError(place_, "a link", kExpectedTar);
  if (archive_entry_sparse_count(entry) > 0)
    throw maps::InputError(place_, "a sparse file", kExpectedTar);
  const auto type = archive_entry_filetype(entry);
  if (type != AE_IFREG && type != AE_IFDIR)
    throw maps::InputError(place_, "neither file nor folder", kExpectedTar);
  TarEntry found{.path = {}, .is_folder = type == AE_IFDIR};
  const la_int64_t bytes = archive_entry_size(entry);
  if (bytes < 0 || (found.is_folder && bytes > 0))
    throw maps::InputError(place_, std::to_string(bytes) + " bytes",
                           found.is_folder ? "none in a folder" : "none or more");
  found.bytes = static_cast<std::uint64_t>(bytes);
  if (found.bytes > limits_->file_bytes)
    throw maps::InputError(place_, std::to_string(bytes) + " bytes",
                           std::to_string(limits_->file_bytes) + " at most");
  found.path = checked_path(path, found.is_folder, limits_->path_bytes, limits_->depth, place_);
  return found;
}

/// Walks the blocks that libarchive has just read for one entry.
void TarReader::check_headers(const std::string& place) const {
  constexpr std::size_t kTypeAt = 156;
  constexpr std::size_t kSizeAt = 124;
  constexpr std::size_t kSizeDigits = 12;
  std::string_view rest = headers_;
  while (rest.size() >= kTarBlock && is_special(rest[kTypeAt])) {
    const auto bytes = octal(rest.substr(kSizeAt, kSizeDigits));
    if (!bytes || *bytes > rest.size() - kTarBlock)
      throw maps::InputError(place, "a header with no sensible size", kExpectedTar);
    const std::string_view body = rest.substr(kTarBlock, *bytes);
    // libarchive would cut a name there; other readers might not.
    if (rest[kTypeAt] != 'L' && body.find('\0') != body.npos)
      throw maps::InputError(place, "a NUL in its headers", kExpectedTar);
    if (rest[kTypeAt] != 'L') check_records(body, place);
    rest.remove_prefix(std::min<std::size_t>(kTarBlock + in_tar_blocks(*bytes), rest.size()));
  }
  if (rest.size() < kTarBlock) throw maps::InputError(place, "no header", kExpectedTar);
  if (const char* refused = refused_type(rest[kTypeAt]))
    throw maps::InputError(place, refused, kExpectedTar);
  if (rest.size() > kTarBlock)
    throw maps::InputError(place, "a header of several blocks", kExpectedTar);
}

std::string_view TarReader::read() {
  const void* bytes = nullptr;
  std::size_t size = 0;
  la_int64_t offset = 0;
  const int result = archive_read_data_block(reader_.get(), &bytes, &size, &offset);
  if (result == ARCHIVE_EOF) {
    check(ARCHIVE_OK, place_);
    if (left_ > 0 || padded_left_ > 0)
      throw maps::InputError(place_, "more bytes than its headers say", "as many");
    return {};
  }
  check(result, place_);
  if (size > left_) throw maps::InputError(place_, "more bytes than its headers say", "as many");
  left_ -= size;
  return {static_cast<const char*>(bytes), size};
}

void TarReader::check_end() {
  const auto is_zero = [](std::string_view bytes) {
    return std::all_of(bytes.begin(), bytes.end(), [](char byte) { return byte == 0; });
  };
  if (headers_.size() != 2 * kTarBlock || !is_zero(headers_))
    throw maps::InputError(name_, "no end, or something behind it",
                           "two blocks of zeros at the end");
  for (std::string_view piece = take(SIZE_MAX); !piece.empty(); piece = take(SIZE_MAX))
    if (!is_zero(piece)) throw maps::InputError(name_, "something behind its end", "zeros only");
}

}  // namespace stillmap::server

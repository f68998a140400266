#include "store/package_archive.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/package_delta.hpp>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include <stillmap/maps/package_files.hpp>
#include <stillmap/maps/sha256.hpp>
#include <stillmap/maps/text.hpp>
#include "store/archive_path.hpp"
#include "store/tar_header.hpp"

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// Part of the entity tag: to be raised with every change of what the bytes of the archive are.
constexpr const char* kLayout = "tar1";
constexpr std::uint64_t kEndBytes = 2 * kTarBlock;

}  // namespace

PackageArchive::PackageArchive(const fs::path& package, const std::optional<fs::path>& without)
    : package_(package) {
  const fs::path manifest_file = package_ / maps::kManifestName;
  const std::string text = maps::read_text(manifest_file);
  const maps::MapManifest manifest = maps::parse_manifest(text, manifest_file.string());
  digest_ = maps::sha256_of(text);
  // In front, so that whoever reads the archive knows early what is to come.
  append(maps::kManifestName, text.size(), digest_);
  auto files = manifest.files;
  if (without) {
    const auto other = maps::MapPackage::open(*without);
    without_ = other->digest();
    files = maps::package_delta(other->manifest(), manifest).missing;
  }
  for (const auto& [path, file] : files) append(path, file.bytes, file.sha256);
  size_ += kEndBytes;
  folder_ = ::open(package_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder_ < 0) throw maps::StorageError(package_.string(), std::strerror(errno));
}

PackageArchive::~PackageArchive() {
  if (file_ >= 0) ::close(file_);
  ::close(folder_);
}

std::string PackageArchive::etag() const {
  const std::string since = without_.empty() ? "" : "-without-" + without_;
  return '"' + digest_ + since + "-" + kLayout + '"';
}

std::optional<PackageArchive::Place> PackageArchive::place_of(std::string_view sha256) const {
  const auto found = std::find_if(entries_.begin(), entries_.end(),
                                  [&](const Entry& entry) { return entry.sha256 == sha256; });
  if (found == entries_.end()) return std::nullopt;
  return Place{found->offset + found->header_bytes, found->bytes};
}

void PackageArchive::append(const std::string& path, std::uint64_t bytes,
                            const std::string& sha256) {
  (void)checked_path(path, false, SIZE_MAX, SIZE_MAX, (package_ / shown_path(path)).string());
  entries_.push_back({path, size_, tar_header_bytes(path, bytes), bytes, sha256});
  size_ += entries_.back().header_bytes + in_tar_blocks(bytes);
}

std::string PackageArchive::files_state() const {
  maps::Sha256 hash;
  for (const Entry& entry : entries_) {
    struct stat found {};
    std::array<std::int64_t, 4> is{};
    if (::fstatat(folder_, entry.path.c_str(), &found, AT_SYMLINK_NOFOLLOW) == 0)
      is = {static_cast<std::int64_t>(found.st_ino), found.st_size, found.st_mtim.tv_sec,
            found.st_mtim.tv_nsec};
    hash.add(is.data(), sizeof is);
  }
  return hash.hex();
}

std::string PackageArchive::first_damaged() const {
  for (const Entry& entry : entries_) {
    try {
      if (maps::sha256_of_file(package_ / entry.path) != entry.sha256) return entry.path;
    } catch (const maps::StorageError&) {
      return entry.path;
    }
  }
  return {};
}

std::size_t PackageArchive::read(std::uint64_t offset, std::span<char> into) {
  std::size_t done = 0;
  while (done < into.size() && offset < size_) {
    const auto after =
        std::upper_bound(entries_.begin(), entries_.end(), offset,
                         [](std::uint64_t at, const Entry& entry) { return at < entry.offset; });
    const auto index = static_cast<std::size_t>(after - entries_.begin()) - 1;
    const std::size_t got = read_entry(index, offset - entries_[index].offset, into.subspan(done));
    done += got;
    offset += got;
  }
  return done;
}

/// What is left of the header, of the bytes, or of the padding and, after the last entry, the end.
std::size_t PackageArchive::read_entry(std::size_t index, std::uint64_t from,
                                       std::span<char> into) {
  const Entry& entry = entries_[index];
  const auto some = [&](std::uint64_t left) {
    return into.first(static_cast<std::size_t>(std::min<std::uint64_t>(left, into.size())));
  };
  if (from < entry.header_bytes) {
    const std::string header = tar_header(entry.path, entry.bytes);
    const std::span<char> part = some(entry.header_bytes - from);
    std::copy_n(header.begin() + static_cast<std::ptrdiff_t>(from), part.size(), part.begin());
    return part.size();
  }
  from -= entry.header_bytes;
  if (from < entry.bytes) {
    const std::span<char> part = some(entry.bytes - from);
    read_file(index, from, part);
    return part.size();
  }
  const std::uint64_t next = index + 1 < entries_.size() ? entries_[index + 1].offset : size_;
  const std::span<char> part = some(next - entry.offset - entry.header_bytes - from);
  std::fill(part.begin(), part.end(), '\0');
  return part.size();
}

void PackageArchive::open_file(std::size_t index) {
  if (file_ >= 0 && file_index_ == index) return;
  const Entry& entry = entries_[index];
  const std::string place = (package_ / entry.path).string();
  if (file_ >= 0) ::close(std::exchange(file_, -1));
  file_ = ::openat(folder_, entry.path.c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
  if (file_ < 0) throw maps::StorageError(place, std::strerror(errno));
  file_index_ = index;
  struct stat status {};
  if (::fstat(file_, &status) == 0 && static_cast<std::uint64_t>(status.st_size) == entry.bytes)
    return;
  ::close(std::exchange(file_, -1));
  throw maps::StorageError(place, "has not " + std::to_string(entry.bytes) + " bytes any more");
}

void PackageArchive::read_file(std::size_t index, std::uint64_t from, std::span<char> into) {
  open_file(index);
  while (!into.empty()) {
    const ssize_t got = ::pread(file_, into.data(), into.size(), static_cast<off_t>(from));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) {
      const std::string reason = got < 0 ? std::strerror(errno) : "has become shorter";
      throw maps::StorageError((package_ / entries_[index].path).string(), reason);
    }
    from += static_cast<std::uint64_t>(got);
    into = into.subspan(static_cast<std::size_t>(got));
  }
}

}  // namespace stillmap::server

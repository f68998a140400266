#include "store/archive_files.hpp"

#include <stillmap/maps/error.hpp>

#include <stdexcept>

#include <stillmap/maps/sha256.hpp>
#include "store/memory_share.hpp"
#include "store/tar_reader.hpp"

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

void check_limits(const ArchiveLimits& limits) {
  if (!(limits.ratio >= 1.0))
    throw std::invalid_argument("ratio: " + std::to_string(limits.ratio) + ", >= 1 expected");
}

/// Puts a tar's entries where they belong.
class Extraction {
 public:
  Extraction(TarReader& tar, const fs::path& target, const ArchiveLimits& limits,
             const DurableFiles& disk, ArchiveFiles& found)
      : tar_(&tar), target_(&target), limits_(&limits), disk_(&disk), found_(&found) {}

  void run(bool hashed) {
    while (const auto entry = tar_->next()) {
      // The root itself; nothing but the files below it matters.
      if (entry->path.empty()) continue;
      make_parents(entry->path);
      if (entry->is_folder)
        make_folder(entry->path);
      else
        write_file(entry->path, hashed);
      refuse_too_many(entry->path);
    }
  }

 private:
  void make_parents(const std::string& path) {
    for (std::size_t at = path.find('/'); at != path.npos; at = path.find('/', at + 1)) {
      const std::string parent = path.substr(0, at);
      if (found_->folders.contains(parent)) continue;
      refuse_file(parent, path);
      disk_->make_folder(*target_ / parent);
      found_->folders.insert(parent);
    }
  }

  void make_folder(const std::string& path) {
    refuse_file(path, path);
    if (!entered_.insert(path).second)
      throw maps::InputError(tar_->place(path), "it twice", "once");
    if (!found_->folders.insert(path).second) return;
    disk_->make_folder(*target_ / path);
  }

  void write_file(const std::string& path, bool hashed) {
    if (found_->folders.contains(path))
      throw maps::InputError(tar_->place(path), "a file", "a folder as before");
    refuse_file(path, path);
    DurableFiles::NewFile file = disk_->create(*target_ / path);
    maps::Sha256 hash;
    maps::MapManifest::File written;
    for (std::string_view piece = tar_->read(); !piece.empty(); piece = tar_->read()) {
      if (hashed) hash.add(piece.data(), piece.size());
      file.append(piece);
      written.bytes += piece.size();
    }
    if (hashed) {
      written.sha256 = hash.hex();
      file.close();
    } else {
      file.finish();
    }
    found_->archive.bytes += written.bytes;
    ++found_->archive.files;
    found_->files.emplace(path, std::move(written));
  }

  void refuse_file(const std::string& there, const std::string& path) const {
    if (!found_->files.contains(there)) return;
    throw maps::InputError(tar_->place(path), there == path ? "it twice" : "it in a file",
                           there == path ? "once" : "a folder");
  }

  void refuse_too_many(const std::string& path) {
    // Of a file: its node in the list, its path and its SHA-256.
    constexpr std::uint64_t kOfEntry = 240;
    list_bytes_ += kOfEntry + path.size();
    const std::uint64_t most = limits_->list_bytes > 0 ? limits_->list_bytes : share_of_memory(16);
    if (list_bytes_ > most)
      throw maps::InputError(tar_->place("..."), "more entries than the memory holds",
                             "fewer and larger files");
    if (found_->files.size() + found_->folders.size() <= limits_->entries) return;
    throw maps::InputError(tar_->place("..."), "more entries",
                           std::to_string(limits_->entries) + " at most");
  }

  TarReader* tar_;
  const fs::path* target_;
  const ArchiveLimits* limits_;
  const DurableFiles* disk_;
  ArchiveFiles* found_;
  /// Folders that had an entry of their own.
  std::set<std::string> entered_;
  std::uint64_t list_bytes_ = 0;
};

}  // namespace

ArchiveFiles unpack_archive(const IncomingArchive& archive, const fs::path& empty,
                            const DurableFiles& disk, bool hashed) {
  const ArchiveLimits& limits = archive.limits;
  check_limits(limits);
  ArchiveFiles found;
  Unpacker unpacker(archive.source, archive.name, limits);
  TarReader tar(unpacker, archive.name, limits);
  Extraction(tar, empty, limits, disk, found).run(hashed);
  found.archive.packed_bytes = unpacker.packed_bytes();
  found.archive.sha256 = unpacker.sha256();
  return found;
}

}  // namespace stillmap::server

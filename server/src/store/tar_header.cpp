#include "store/tar_header.hpp"

#include <archive.h>
#include <archive_entry.h>

#include <algorithm>
#include <memory>
#include <stdexcept>
#include <utility>

namespace stillmap::server {
namespace {

struct FreeWriter {
  void operator()(archive* writer) const { archive_write_free(writer); }
};
struct FreeEntry {
  void operator()(archive_entry* entry) const { archive_entry_free(entry); }
};

struct Written {
  std::string text;
  bool is_whole = false;
};

la_ssize_t append_to(archive* /*writer*/, void* client, const void* bytes, std::size_t size) {
  auto& written = *static_cast<Written*>(client);
  // When it goes, the writer would fill up the file with zeros, and write an end.
  if (written.is_whole) return -1;
  written.text.append(static_cast<const char*>(bytes), size);
  return static_cast<la_ssize_t>(size);
}

}  // namespace

std::string tar_header(const std::string& path, std::uint64_t bytes) {
  Written written;  // outlives the writer
  const std::unique_ptr<archive, FreeWriter> writer(archive_write_new());
  const std::unique_ptr<archive_entry, FreeEntry> entry(archive_entry_new());
  if (!writer || !entry) throw std::runtime_error("libarchive is not available");
  archive_entry_set_pathname(entry.get(), path.c_str());
  archive_entry_set_filetype(entry.get(), AE_IFREG);
  archive_entry_set_perm(entry.get(), 0644);
  archive_entry_set_size(entry.get(), static_cast<la_int64_t>(bytes));
  archive_entry_set_mtime(entry.get(), 0, 0);
  // Blocks of 0 bytes: nothing is held back.
  const bool made =
      archive_write_set_format_pax_restricted(writer.get()) == ARCHIVE_OK &&
      archive_write_set_bytes_per_block(writer.get(), 0) == ARCHIVE_OK &&
      archive_write_open(writer.get(), &written, nullptr, &append_to, nullptr) == ARCHIVE_OK &&
      archive_write_header(writer.get(), entry.get()) == ARCHIVE_OK;
  if (!made) {
    const char* reason = archive_error_string(writer.get());
    throw std::runtime_error("tar header of " + path + ": " + (reason ? reason : "failed"));
  }
  // Not `archive_write_fail`, after which libarchive 3.6 does not free all.
  written.is_whole = true;
  return std::move(written.text);
}

std::uint64_t tar_header_bytes(const std::string& path, std::uint64_t bytes) {
  constexpr std::size_t kUstarName = 100;
  constexpr std::uint64_t kUstarBytes = std::uint64_t{1} << 33U;
  const bool fits = path.size() <= kUstarName && bytes < kUstarBytes &&
                    std::all_of(path.begin(), path.end(), [](char c) { return c > 0 && c < 0x7f; });
  return fits ? 512 : tar_header(path, bytes).size();
}

}  // namespace stillmap::server

// Archives as they are uploaded: unpacked into a folder in memory, then taken for a map package.
// The first byte says what is done to the rest before: 1 makes the checksums of its headers right,
// which no fuzzer would find; 2 puts an end behind it; 4 gives it in pieces of 37 bytes.
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <string_view>

#include "store/archive_files.hpp"
#include "store/incoming_package.hpp"
#include "support/disk_calls.hpp"
#include "support/temporary_folder.hpp"

namespace {

namespace fs = std::filesystem;
using namespace stillmap;

constexpr std::size_t kBlock = 512;
constexpr server::ArchiveLimits kLimits{.entries = 50,
                                        .file_bytes = 1U << 16U,
                                        .total_bytes = 1U << 18U,
                                        .path_bytes = 200,
                                        .depth = 5};

void require(bool holds, const char* rule) {
  if (holds) return;
  std::fprintf(stderr, "broken rule: %s\n", rule);
  std::abort();
}

/// Of every block that says that it is a header.
void mend_checksums(std::string& tar) {
  for (std::size_t at = 0; at + kBlock <= tar.size(); at += kBlock) {
    if (tar.compare(at + 257, 5, "ustar") != 0) continue;
    tar.replace(at + 148, 8, "        ");
    unsigned sum = 0;
    for (std::size_t i = 0; i < kBlock; ++i) sum += static_cast<unsigned char>(tar[at + i]);
    char digits[8];
    std::snprintf(digits, sizeof digits, "%06o", sum);
    tar.replace(at + 148, 7, digits, 7);
  }
}

server::ByteSource source_of(std::string_view bytes, std::size_t piece) {
  return [bytes, piece](std::span<char> into) mutable {
    const std::size_t size = std::min({into.size(), piece, bytes.size()});
    std::copy_n(bytes.begin(), size, into.begin());
    bytes.remove_prefix(size);
    return size;
  };
}

/// What is said to be there is there, as regular files and folders, and nothing else.
void require_found(const fs::path& folder, const server::ArchiveFiles& found) {
  std::size_t files = 0;
  std::size_t folders = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    const std::string path = entry.path().lexically_relative(folder).string();
    const fs::file_type type = entry.symlink_status().type();
    require(type == fs::file_type::regular || type == fs::file_type::directory,
            "only files and folders");
    require(path.size() <= kLimits.path_bytes, "no path beyond the limit");
    if (type == fs::file_type::directory) {
      ++folders;
      require(found.folders.contains(path), "every folder is known");
      continue;
    }
    ++files;
    const auto at = found.files.find(path);
    require(at != found.files.end() && at->second.bytes == entry.file_size() &&
                at->second.bytes <= kLimits.file_bytes,
            "every file is known with its size");
  }
  require(files == found.files.size() && folders == found.folders.size() &&
              files + folders <= kLimits.entries,
          "everything known is there, up to the limit");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const test::TemporaryFolder scratch(test::memory_folder());
  static test::UnsyncedCalls calls;
  if (size == 0) return 0;
  std::string bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  if (data[0] & 1U) mend_checksums(bytes);
  if (data[0] & 2U) bytes.append(2 * kBlock, '\0');
  const std::size_t piece = data[0] & 4U ? 37 : SIZE_MAX;

  const fs::path folder = scratch.path() / "target";
  fs::create_directory(folder);
  const server::DurableFiles disk(calls);
  try {
    const server::ArchiveFiles found =
        server::unpack_archive({source_of(bytes, piece), "fuzz", kLimits}, folder, disk, true);
    require(found.archive.packed_bytes == bytes.size(), "all is read");
    require_found(folder, found);
    const server::IncomingPackage package = server::keep_package(folder, found, "fuzz", disk);
    require(fs::exists(package.folder / "manifest.json"), "a package has a manifest");
  } catch (const maps::InputError&) {
  }
  require(std::distance(fs::directory_iterator(scratch.path()), {}) == 1, "nothing lies outside");
  fs::remove_all(folder);
  return 0;
}

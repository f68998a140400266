#include "store/shared_files.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/mapped_file.hpp>

#include <algorithm>
#include <set>
#include <string>
#include <system_error>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// Smaller ones take a block each way.
constexpr std::uint64_t kLeastBytes = 4096;

bool are_equal(const fs::path& one, const fs::path& other) {
  const maps::MappedFile a(one), b(other);
  return std::ranges::equal(a.bytes(), b.bytes());
}

/// Puts a second name of `from` in the place of `to`. @return false where there is no link.
bool replace_by_link(const fs::path& from, const fs::path& to, const DurableFiles& files) {
  const fs::path link = to.string() + ".shared";
  if (!files.link(from, link)) return false;
  files.rename(link, to);
  return true;
}

}  // namespace

void add_files_of(const fs::path& package, KnownFiles& known) {
  try {
    const auto opened = maps::MapPackage::open(package);
    for (const auto& [path, file] : opened->manifest().files)
      known.emplace(file.sha256, package / path);
  } catch (const maps::InputError&) {
  } catch (const maps::StorageError&) {
  }
}

std::uint64_t share_files(const fs::path& package, const KnownFiles& known,
                          const DurableFiles& files) {
  std::uint64_t shared = 0;
  std::set<fs::path> folders;
  const auto own = maps::MapPackage::open(package);
  for (const auto& [path, file] : own->manifest().files) {
    const auto found = known.find(file.sha256);
    if (found == known.end() || file.bytes < kLeastBytes) continue;
    const fs::path& from = found->second;
    const fs::path to = package / path;
    std::error_code error;
    if (fs::equivalent(from, to, error)) continue;
    try {
      if (!are_equal(from, to)) continue;
    } catch (const maps::StorageError&) {
      continue;
    }
    if (!replace_by_link(from, to, files)) break;
    folders.insert(to.parent_path());
    shared += file.bytes;
  }
  for (const fs::path& folder : folders) files.sync_folder(folder);
  return shared;
}

}  // namespace stillmap::server

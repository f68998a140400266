#include "store/package_folder.hpp"

#include <unistd.h>

#include <stillmap/maps/derived_leftovers.hpp>
#include <stillmap/maps/map_package.hpp>

#include <atomic>
#include <exception>
#include <memory>
#include <stdexcept>
#include <utility>

#include "store/store_folder.hpp"

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

std::string problems_text(const std::vector<std::string>& files) {
  std::string text = "not what the manifest says:";
  for (const std::string& file : files) text += " " + file;
  return text;
}

}  // namespace

PackageFolder::PackageFolder(fs::path folder, DiskCalls& calls)
    : folder_(std::move(folder)), files_(calls) {}

fs::path PackageFolder::path_of(std::string_view digest) const { return folder_ / digest; }

std::vector<std::string> PackageFolder::digests() const {
  std::vector<std::string> digests = folders_in(folder_);
  std::erase_if(digests, [](const std::string& name) { return !is_digest(name); });
  return digests;
}

bool PackageFolder::has(const std::string& digest) const { return is_there(path_of(digest)); }

bool PackageFolder::has_whole(const std::string& digest) const {
  return has(digest) && damage_of(digest).empty();
}

std::string PackageFolder::damage_of(const std::string& digest) const {
  try {
    const std::shared_ptr<const maps::MapPackage> package = maps::MapPackage::open(path_of(digest));
    if (package->digest() != digest) return "its manifest has another digest";
    const std::vector<std::string> broken = package->verify();
    return broken.empty() ? "" : problems_text(broken);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
}

void PackageFolder::remove(const std::string& digest) const {
  const fs::path removed = folder_ / (kRemoved + digest);
  if (is_there(removed)) files_.remove_tree(removed);
  if (!has(digest)) return;
  files_.rename(path_of(digest), removed);
  sync();
  files_.remove_tree(removed);
}

std::size_t PackageFolder::clear_leftovers() const {
  std::size_t cleared = 0;
  for (const std::string& name : folders_in(folder_)) {
    const fs::path folder = folder_ / name;
    if (is_digest(name)) {
      for (const char* derived : kDerivedFolders)
        cleared += maps::clear_derived_leftovers(folder / derived);
      continue;
    }
    if (name.starts_with(kIncoming)) {
      if (!FolderLock::try_folder(folder)) continue;
    } else if (!name.starts_with(kRemoved)) {
      continue;
    }
    files_.remove_tree(folder);
    ++cleared;
  }
  return cleared;
}

void PackageFolder::sync() const { files_.sync_folder(folder_); }

PackageFolder::Incoming::Incoming(const PackageFolder& packages, DurableFiles files)
    : files_(files) {
  static std::atomic<unsigned> count{0};
  do
    path_ =
        packages.path() / (kIncoming + std::to_string(::getpid()) + "-" + std::to_string(count++));
  while (!files_.make_folder(path_));
  lock_ = FolderLock::try_folder(path_);
}

PackageFolder::Incoming::~Incoming() {
  if (!lock_ || stays_) return;
  try {
    files_.remove_tree(path_);
  } catch (const std::exception&) {
    // The error that brought us here says more; the next open clears the folder.
  }
}

void PackageFolder::Incoming::publish(const fs::path& package, const fs::path& target) {
  if (!is_there(target)) {
    files_.rename(package, target);
    stays_ = package == path_;
    return;
  }
  files_.exchange(package, target);
  // Until it is sure to last, a power cut may bring the other one back, so it must not be
  // emptied.
  stays_ = true;
  files_.sync_folder(target.parent_path());
  stays_ = false;
}

}  // namespace stillmap::server

#include "blobs/s3_packages.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <ctime>
#include <map>
#include <memory>
#include <utility>

#include <stillmap/maps/package_files.hpp>
#include <stillmap/maps/sha256.hpp>
#include <stillmap/maps/text.hpp>
#include "blobs/parallel.hpp"
#include "store/store_folder.hpp"

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

constexpr const char* kBlobKeys = "blobs/";

/// As the cache takes them.
constexpr std::uint64_t kMostManifestBytes = std::uint64_t{1} << 30U;

std::string key_of(const std::string& sha256) { return kBlobKeys + sha256; }

/// A file of a package that lies in a folder.
struct PackageFile {
  fs::path path;
  std::uint64_t bytes;
  std::string sha256;
};

/// Each content once, the manifest last.
std::vector<PackageFile> files_in(const fs::path& package) {
  const fs::path file = package / maps::kManifestName;
  const std::string text = maps::read_text(file);
  std::vector<PackageFile> files;
  std::set<std::string> seen;
  for (const auto& [path, listed] : maps::parse_manifest(text, file.string()).files)
    if (seen.insert(listed.sha256).second)
      files.push_back({package / path, listed.bytes, listed.sha256});
  files.push_back({file, text.size(), maps::sha256_of(text)});
  return files;
}

/// Such as 2026-11-30T12:00:00.000Z. @return nothing for another text.
std::optional<std::chrono::system_clock::time_point> parse_modified(const std::string& text) {
  std::tm parts{};
  if (::strptime(text.c_str(), "%Y-%m-%dT%H:%M:%S", &parts) == nullptr) return std::nullopt;
  return std::chrono::system_clock::from_time_t(::timegm(&parts));
}

/// How long an S3 that did not answer is not asked again by those who do not wait for it.
constexpr std::chrono::seconds kNotAskedAgain{5};

S3Options hasty(S3Options options) {
  options.retry.attempts = 1;
  options.transport.connect_timeout = std::chrono::milliseconds(1'000);
  options.transport.stall_timeout = std::chrono::seconds(3);
  return options;
}

std::int64_t last_change_ns(const fs::path& path) {
  struct stat found {};
  if (::stat(path.c_str(), &found) != 0) return 0;
  return std::int64_t{1'000'000'000} * found.st_mtim.tv_sec + found.st_mtim.tv_nsec;
}

/// "3 files missing: a, b, ..."
std::string list_text(const char* what, const std::vector<std::string>& paths) {
  constexpr std::size_t kMostNamed = 5;
  if (paths.empty()) return {};
  std::string text = fmt::format("{} {}:", paths.size(), what);
  for (std::size_t i = 0; i < std::min(paths.size(), kMostNamed); ++i) text += " " + paths[i];
  return paths.size() > kMostNamed ? text + " ..." : text;
}

}  // namespace

S3Packages::S3Packages(const S3PackagesOptions& options, DiskCalls& calls, S3Client::Clock clock)
    : options_(options),
      files_(calls),
      client_(options.s3, clock),
      hasty_client_(hasty(options.s3), clock),
      cache_(
          options.cache,
          [this](const std::string& sha256, const BlobCache::Sink& sink) {
            client_.get(key_of(sha256), sink);
          },
          calls),
      packages_(cache_.folder() / kPackagesName, calls),
      clock_(std::move(clock)) {
  const FolderLock lock = cache_.locked();
  files_.make_folder(packages_.path());
  (void)packages_.clear_leftovers();
  cache_.set_release([this] { return release_one(); });
}

bool S3Packages::release_one() const {
  std::vector<std::pair<std::int64_t, std::string>> by_use;
  if (!is_there(packages_.path())) return false;
  for (const std::string& digest : packages_.digests())
    by_use.emplace_back(last_change_ns(packages_.path_of(digest)), digest);
  std::ranges::sort(by_use);
  for (const auto& [used_ns, digest] : by_use) {
    const auto unread = FolderLock::try_folder(packages_.path_of(digest));
    if (!unread) continue;
    packages_.remove(digest);
    return true;
  }
  return false;
}

std::optional<PackageBlobs::Local> S3Packages::find_local(const std::string& digest) const {
  const fs::path folder = packages_.path_of(digest);
  if (!is_there(folder / maps::kManifestName)) return std::nullopt;
  std::optional<FolderLock> lock;
  try {
    lock = FolderLock::try_folder(folder, FolderLock::Kind::kShared);
  } catch (const maps::StorageError&) {
    // Taken apart just now.
    return std::nullopt;
  }
  if (!lock || !lock->is_of(folder)) return std::nullopt;
  // Best effort: it goes earlier if its use is not noted.
  (void)::utimensat(AT_FDCWD, folder.c_str(), nullptr, 0);
  return Local{folder, std::make_shared<FolderLock>(std::move(*lock))};
}

PackageBlobs::Local S3Packages::bring(const std::string& digest) {
  // Another process may take it apart between its coming and its pinning.
  constexpr int kTries = 20;
  for (int tries = 0; tries < kTries; ++tries) {
    if (auto local = find_local(digest)) return std::move(*local);
    {
      std::unique_lock lock(mutex_);
      if (!coming_.insert(digest).second) {
        made_.wait(lock, [&] { return !coming_.contains(digest); });
        continue;
      }
    }
    const auto end = [&](S3Packages* self) {
      const std::scoped_lock lock(self->mutex_);
      self->coming_.erase(digest);
      self->made_.notify_all();
    };
    const std::unique_ptr<S3Packages, decltype(end)> coming(this, end);
    make_local(digest);
  }
  throw maps::StorageError(packages_.path_of(digest).string(),
                           "goes before it can be read: raise cache_bytes");
}

bool S3Packages::drop_damaged(const std::string& digest) {
  const fs::path folder = packages_.path_of(digest);
  const auto is_whole = [](const fs::path& file, const std::string& sha256) {
    try {
      return maps::sha256_of_file(file) == sha256;
    } catch (const maps::StorageError&) {
      return false;
    }
  };
  std::set<std::string> wrong;
  // A manifest from which no folder could be made.
  if (cache_.has(digest) && !is_whole(cache_.place_of(digest), digest)) wrong.insert(digest);
  const fs::path file = folder / maps::kManifestName;
  if (is_there(folder) && !is_whole(file, digest)) {
    // It does not say which files there are.
    wrong.insert(digest);
  } else if (is_there(folder)) {
    for (const auto& [path, listed] : maps::parse_manifest(maps::read_text(file), digest).files)
      if (!is_whole(folder / path, listed.sha256)) wrong.insert(listed.sha256);
  }
  if (wrong.empty()) return false;
  const FolderLock lock = cache_.locked();
  for (const std::string& sha256 : wrong) cache_.remove(sha256);
  // Who reads it keeps what is open.
  packages_.remove(digest);
  return true;
}

maps::MapManifest S3Packages::manifest(const std::string& digest) {
  return maps::parse_manifest(cache_.open(digest).text(), client_.name_of(key_of(digest)));
}

maps::MapManifest S3Packages::manifest_if_near(const std::string& digest) {
  if (cache_.has(digest)) return manifest(digest);
  const std::string name = client_.name_of(key_of(digest));
  {
    const std::scoped_lock lock(mutex_);
    if (away_because_ && std::chrono::steady_clock::now() < away_until_)
      throw S3Error(*away_because_);
  }
  std::string text;
  try {
    // Not by the cache: another thread may wait long there for the same one.
    text = hasty_client_.get_text(key_of(digest), kMostManifestBytes);
  } catch (const S3Error& error) {
    if (error.is_missing()) throw;
    const std::scoped_lock lock(mutex_);
    away_because_ = error;
    away_until_ = std::chrono::steady_clock::now() + kNotAskedAgain;
    throw;
  }
  if (maps::sha256_of(text) != digest)
    throw maps::InputError(name, "SHA-256 " + maps::sha256_of(text),
                           "what its name says: add the package to the store again");
  return maps::parse_manifest(text, name);
}

void S3Packages::bring_file(const maps::MapManifest::File& file, const fs::path& to) {
  cache_.link(file.sha256, file.bytes, to);
}

void S3Packages::make_local(const std::string& digest) {
  const std::string text = cache_.open(digest).text();
  const maps::MapManifest manifest = maps::parse_manifest(text, client_.name_of(key_of(digest)));
  std::uint64_t bytes = text.size();
  for (const auto& [path, file] : manifest.files) bytes += file.bytes;
  if (bytes > options_.cache.most_bytes)
    throw maps::StorageError(
        cache_.folder().string(),
        fmt::format("a package of {} bytes does not fit into {}: raise cache_bytes", bytes,
                    options_.cache.most_bytes));
  std::unique_ptr<PackageFolder::Incoming> incoming;
  {
    const FolderLock lock = cache_.locked();
    files_.make_folder(packages_.path());
    incoming = std::make_unique<PackageFolder::Incoming>(packages_, files_);
  }
  std::set<fs::path> folders = {incoming->path()};
  std::vector<std::pair<fs::path, maps::MapManifest::File>> links;
  links.emplace_back(incoming->path() / maps::kManifestName,
                     maps::MapManifest::File{text.size(), digest});
  for (const auto& [path, file] : manifest.files) {
    links.emplace_back(incoming->path() / path, file);
    for (fs::path folder = links.back().first.parent_path(); folders.insert(folder).second;)
      folder = folder.parent_path();
  }
  // From the top: a folder comes before those in it.
  for (const fs::path& folder : folders)
    if (folder != incoming->path()) files_.make_folder(folder);
  for_each_in_parallel(links.size(), options_.s3.transport.connections, [&](std::size_t i) {
    cache_.link(links[i].second.sha256, links[i].second.bytes, links[i].first);
  });
  for (const fs::path& folder : folders) files_.sync_folder(folder);
  const FolderLock lock = cache_.locked();
  const fs::path target = packages_.path_of(digest);
  // What is derived from a package may come to its place after it has gone from there.
  if (is_there(target) && !is_there(target / maps::kManifestName)) packages_.remove(digest);
  if (!is_there(target)) incoming->publish(incoming->path(), target);
}

void S3Packages::put_missing(const fs::path& package, const FileBytes& there, bool again,
                             bool is_first_time) {
  std::vector<PackageFile> files = files_in(package);
  const PackageFile manifest = files.back();
  std::erase_if(files, [&](const PackageFile& file) { return there.contains(file.sha256); });
  const auto put = [&](const PackageFile& file) {
    const std::string key = key_of(file.sha256);
    if (again || client_.size_of(key) != file.bytes) client_.put_file(key, file.path, file.sha256);
    // It will be read soon, and need not be fetched then.
    if (is_first_time) cache_.adopt(file.sha256, file.path);
  };
  const bool has_manifest = !files.empty() && files.back().sha256 == manifest.sha256;
  for_each_in_parallel(files.size() - (has_manifest ? 1 : 0), options_.s3.transport.connections,
                       [&](std::size_t i) { put(files[i]); });
  // Without it nobody takes the others for a package.
  if (has_manifest) put(manifest);
}

void S3Packages::send(const fs::path& package, const FileBytes& there, bool again) {
  put_missing(package, there, again, /*is_first_time=*/true);
}

void S3Packages::confirm(const fs::path& package, const FileBytes& there) {
  put_missing(package, there, /*again=*/false, /*is_first_time=*/false);
}

/// @return "" for the right bytes, "missing" or "wrong".
std::string S3Packages::wrong_with(const std::string& sha256, std::uint64_t bytes) {
  maps::Sha256 hash;
  std::uint64_t received = 0;
  try {
    client_.get(key_of(sha256), [&](std::string_view piece) {
      hash.add(piece.data(), piece.size());
      received += piece.size();
    });
  } catch (const S3Error& error) {
    if (error.is_missing()) return "missing";
    throw;
  }
  return received == bytes && hash.hex() == sha256 ? "" : "wrong";
}

std::string S3Packages::damage_of(const std::string& digest, Verified& known) {
  std::string text;
  try {
    text = client_.get_text(key_of(digest), kMostManifestBytes);
  } catch (const S3Error& error) {
    if (error.is_missing()) return "its manifest is missing: " + client_.name_of(key_of(digest));
    throw;
  }
  if (maps::sha256_of(text) != digest)
    return "its manifest is wrong: " + client_.name_of(key_of(digest));
  const maps::MapManifest manifest = maps::parse_manifest(text, client_.name_of(key_of(digest)));
  std::map<std::string, std::uint64_t> unread;
  for (const auto& [path, file] : manifest.files)
    if (!known.contains(file.sha256)) unread.emplace(file.sha256, file.bytes);
  const std::vector<std::pair<std::string, std::uint64_t>> list(unread.begin(), unread.end());
  std::vector<std::string> found(list.size());
  for_each_in_parallel(list.size(), options_.s3.transport.connections, [&](std::size_t i) {
    found[i] = wrong_with(list[i].first, list[i].second);
  });
  for (std::size_t i = 0; i < list.size(); ++i) known.emplace(list[i].first, found[i]);
  std::vector<std::string> missing;
  std::vector<std::string> wrong;
  for (const auto& [path, file] : manifest.files) {
    const std::string& what = known.at(file.sha256);
    if (!what.empty()) (what == "missing" ? missing : wrong).push_back(path);
  }
  const std::string of_missing = list_text("objects missing", missing);
  const std::string of_wrong = list_text("objects wrong", wrong);
  return of_missing + (of_missing.empty() || of_wrong.empty() ? "" : "; ") + of_wrong;
}

void S3Packages::remove(const std::string& digest, const FileBytes& kept) {
  std::optional<maps::MapManifest> manifest;
  try {
    manifest = maps::parse_manifest(client_.get_text(key_of(digest), kMostManifestBytes), digest);
  } catch (const S3Error& error) {
    // Removed by an earlier try that ended before it said so.
    if (!error.is_missing()) throw;
  } catch (const maps::InputError&) {
    // A damaged manifest tells no files: `unnamed` finds them.
  }
  std::set<std::string> gone;
  if (manifest)
    for (const auto& [path, file] : manifest->files)
      if (!kept.contains(file.sha256)) gone.insert(file.sha256);
  remove_blobs({gone.begin(), gone.end()});
  if (!kept.contains(digest)) client_.remove(key_of(digest));
  const FolderLock lock = cache_.locked();
  if (!packages_.has(digest)) return;
  // One that is read stays until the cache needs its room.
  if (FolderLock::try_folder(packages_.path_of(digest))) packages_.remove(digest);
}

void S3Packages::remove_blobs(const std::vector<std::string>& sha256s) {
  for_each_in_parallel(sha256s.size(), options_.s3.transport.connections,
                       [&](std::size_t i) { client_.remove(key_of(sha256s[i])); });
}

std::vector<std::string> S3Packages::unnamed(const FileBytes& named) {
  std::vector<std::string> found;
  std::size_t known = 0;
  std::size_t all = 0;
  const auto newest = clock_() - options_.least_age;
  client_.list(kBlobKeys, [&](const S3Client::Listed& each) {
    const std::string sha256 = each.key.substr(std::string_view(kBlobKeys).size());
    if (!is_digest(sha256)) return;
    ++all;
    if (named.contains(sha256)) {
      ++known;
      return;
    }
    const auto modified = parse_modified(each.modified);
    if (modified && *modified <= newest) found.push_back(sha256);
  });
  if (all > 0 && known == 0)
    throw maps::InputError(client_.name_of(kBlobKeys),
                           fmt::format("{} blobs that this store does not know", all),
                           "its own: if they are of no other store, remove them by a tool for S3");
  return found;
}

PackageBlobs::Figures S3Packages::figures() const {
  const S3Client::Figures client = client_.figures();
  const BlobCache::Figures cache = cache_.figures();
  const S3Client::Figures hasty = hasty_client_.figures();
  return {.is_away = client.is_away,
          .answered = client.answered + hasty.answered,
          .failed = client.failed + hasty.failed,
          .local_bytes = cache.used_bytes,
          .found = cache.found,
          .fetched = cache.fetched};
}

}  // namespace stillmap::server

#include "store/package_copy.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <limits>
#include <set>
#include <vector>

#include <stillmap/maps/package_files.hpp>
#include <stillmap/maps/sha256.hpp>
#include <stillmap/maps/text.hpp>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// A regular file, open for reading; links are not followed and pipes not waited for.
class Source {
 public:
  explicit Source(fs::path file)
      : file_(std::move(file)),
        descriptor_(::open(file_.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC)) {
    if (descriptor_ < 0) {
      if (errno == ENOENT || errno == ENOTDIR)
        throw maps::InputError(file_.string(), "nothing", "a file of the package: copy it whole");
      if (errno == ELOOP)
        throw maps::InputError(file_.string(), "a link",
                               "a regular file: copy it in place of the link");
      throw maps::StorageError(file_.string(), std::strerror(errno));
    }
    struct stat status {};
    const bool regular = ::fstat(descriptor_, &status) == 0 && S_ISREG(status.st_mode);
    if (regular) return;
    ::close(descriptor_);
    throw maps::InputError(file_.string(), "no regular file", "one");
  }
  ~Source() { ::close(descriptor_); }
  Source(const Source&) = delete;
  Source& operator=(const Source&) = delete;

  /// @return what is read into the buffer; empty at the end.
  std::string_view read(std::vector<char>& buffer) const {
    while (true) {
      const ssize_t got = ::read(descriptor_, buffer.data(), buffer.size());
      if (got >= 0) return {buffer.data(), static_cast<std::size_t>(got)};
      if (errno != EINTR) throw maps::StorageError(file_.string(), std::strerror(errno));
    }
  }

 private:
  fs::path file_;
  int descriptor_;
};

void copy_listed(const fs::path& from, const fs::path& to, const maps::MapManifest::File& listed,
                 const DurableFiles& files) {
  const maps::MapManifest::File copied = copy_file(from, to, listed.bytes, files);
  if (copied.bytes != listed.bytes)
    throw maps::InputError(from.string(), std::to_string(copied.bytes) + " bytes",
                           std::to_string(listed.bytes) + " as in manifest.json: copy it again");
  if (copied.sha256 != listed.sha256)
    throw maps::InputError(from.string(), "SHA-256 " + copied.sha256,
                           listed.sha256 + " as in manifest.json: copy it again");
}

/// Every folder that a listed file lies in, those above before those below.
std::set<fs::path> folders_of(const maps::MapManifest& manifest) {
  std::set<fs::path> folders;
  for (const auto& [path, file] : manifest.files)
    for (fs::path at = fs::path(path).parent_path(); !at.empty(); at = at.parent_path())
      folders.insert(at);
  return folders;
}

}  // namespace

maps::MapManifest::File copy_file(const fs::path& from, const fs::path& to, std::uint64_t most,
                                  const DurableFiles& files) {
  const Source source(from);
  DurableFiles::NewFile target = files.create(to);
  maps::MapManifest::File copied;
  maps::Sha256 hash;
  std::vector<char> buffer(std::size_t{1} << 20U);
  for (std::string_view piece = source.read(buffer); !piece.empty(); piece = source.read(buffer)) {
    copied.bytes += piece.size();
    if (copied.bytes > most)
      throw maps::InputError(from.string(), "more bytes", std::to_string(most) + " at most");
    hash.add(piece.data(), piece.size());
    target.append(piece);
  }
  target.finish();
  copied.sha256 = hash.hex();
  return copied;
}

CopiedPackage copy_package(const fs::path& package, const fs::path& empty,
                           const DurableFiles& files, const std::function<void()>& before_each) {
  const fs::path manifest_file = package / maps::kManifestName;
  const std::string text = maps::read_text(manifest_file);
  const maps::MapManifest manifest = maps::parse_manifest(text, manifest_file.string());
  CopiedPackage copied{.digest = maps::sha256_of(text), .bytes = text.size()};
  const std::set<fs::path> folders = folders_of(manifest);
  for (const fs::path& folder : folders) files.make_folder(empty / folder);
  for (const auto& [path, file] : manifest.files) {
    if (before_each) before_each();
    copy_listed(package / path, empty / path, file, files);
    copied.bytes += file.bytes;
  }
  DurableFiles::NewFile target = files.create(empty / maps::kManifestName);
  target.append(text);
  target.finish();
  std::error_code unreadable;
  if (fs::symlink_status(package / maps::kBuildName, unreadable).type() != fs::file_type::not_found)
    copy_file(package / maps::kBuildName, empty / maps::kBuildName, kLargestBuildJson, files);
  for (const fs::path& folder : folders) files.sync_folder(empty / folder);
  files.sync_folder(empty);
  return copied;
}

bool link_package(const fs::path& package, const fs::path& empty, const DurableFiles& files) {
  const fs::path manifest_file = package / maps::kManifestName;
  const maps::MapManifest manifest =
      maps::parse_manifest(maps::read_text(manifest_file), manifest_file.string());
  const std::set<fs::path> folders = folders_of(manifest);
  for (const fs::path& folder : folders) files.make_folder(empty / folder);
  std::vector<fs::path> names = {maps::kManifestName};
  for (const auto& [path, file] : manifest.files) names.emplace_back(path);
  std::error_code unreadable;
  if (fs::symlink_status(package / maps::kBuildName, unreadable).type() != fs::file_type::not_found)
    names.emplace_back(maps::kBuildName);
  for (const fs::path& name : names)
    if (!files.link(package / name, empty / name)) return false;
  for (const fs::path& folder : folders) files.sync_folder(empty / folder);
  files.sync_folder(empty);
  return true;
}

}  // namespace stillmap::server

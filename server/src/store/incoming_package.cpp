#include "store/incoming_package.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fmt/format.h>

#include <map>
#include <set>
#include <string_view>
#include <vector>

#include <stillmap/maps/package_files.hpp>
#include <stillmap/maps/text.hpp>
#include "store/memory_share.hpp"

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// What comes before the package's own paths: nothing, or one folder's name with its slash.
std::string find_root(const ArchiveFiles& found, const std::string& name) {
  if (found.files.contains(maps::kManifestName)) return {};
  std::vector<std::string> roots;
  for (const std::string& folder : found.folders) {
    const bool is_on_top = folder.find('/') == folder.npos;
    if (is_on_top && found.files.contains(folder + "/" + maps::kManifestName))
      roots.push_back(folder + "/");
  }
  if (roots.size() == 1) return roots.front();
  throw maps::InputError(name, roots.empty() ? "no manifest.json" : "several map packages",
                         "one map package, by itself or in one folder: pack that folder");
}

/// Of a file that is read into memory as a whole, where it takes up to 20 times as much.
void check_size(const std::string& place, std::uint64_t bytes,
                std::uint64_t most = share_of_memory(64)) {
  if (bytes <= most) return;
  throw maps::InputError(place, std::to_string(bytes) + " bytes",
                         std::to_string(most) + " at most");
}

void check_listed(const std::string& path, const maps::MapManifest::File& listed,
                  const std::string& root, const ArchiveFiles& found, const std::string& name) {
  const std::string place = name + ": " + path;
  const auto at = found.files.find(root + path);
  if (at == found.files.end())
    throw maps::InputError(place, "nothing", "a file of the package: pack or copy it whole");
  if (at->second.bytes != listed.bytes)
    throw maps::InputError(
        place, std::to_string(at->second.bytes) + " bytes",
        std::to_string(listed.bytes) + " as in manifest.json: pack or copy it again");
  if (at->second.sha256 != listed.sha256)
    throw maps::InputError(place, "SHA-256 " + at->second.sha256,
                           listed.sha256 + " as in manifest.json: pack or copy it again");
}

/// Removes all but these files, and folders that hold none of them.
/// @return the folders that stay.
std::set<std::string> drop_others(const fs::path& unpacked, const ArchiveFiles& found,
                                  const std::set<std::string>& kept, const std::string& root,
                                  const DurableFiles& disk) {
  std::set<std::string> folders;
  for (const std::string& path : kept)
    for (std::size_t at = path.find('/'); at != path.npos; at = path.find('/', at + 1))
      folders.insert(path.substr(0, at));
  for (const auto& [path, file] : found.files)
    if (path.starts_with(root) && !kept.contains(path)) disk.remove_file(unpacked / path);
  // Backwards, so that a folder comes after those in it.
  for (auto folder = found.folders.rbegin(); folder != found.folders.rend(); ++folder)
    if (folder->starts_with(root) && !folders.contains(*folder))
      disk.remove_folder(unpacked / *folder);
  return folders;
}

/// Puts known files to their places where none was sent.
void take_known(const maps::MapManifest& manifest, const FindFile& known, const std::string& root,
                const fs::path& unpacked, const DurableFiles& disk, ArchiveFiles& found) {
  for (const auto& [path, listed] : manifest.files) {
    if (!known || found.files.contains(root + path)) continue;
    const std::optional<fs::path> at = known(listed);
    if (!at) continue;
    const std::string place = root + path;
    for (std::size_t end = place.find('/'); end != place.npos; end = place.find('/', end + 1)) {
      const std::string folder = place.substr(0, end);
      if (found.folders.insert(folder).second) disk.make_folder(unpacked / folder);
    }
    // What lies there may be damaged since.
    maps::MapManifest::File copied{listed.bytes, maps::sha256_of_file(*at)};
    if (copied.sha256 != listed.sha256) continue;
    if (!disk.link(*at, unpacked / place))
      copied = copy_file(*at, unpacked / place, listed.bytes, disk);
    found.files.emplace(place, std::move(copied));
  }
}

}  // namespace

IncomingPackage keep_package(const fs::path& unpacked, const ArchiveFiles& sent,
                             const std::string& name, const DurableFiles& disk,
                             const FindFile& known) {
  ArchiveFiles found = sent;
  const std::string root = find_root(found, name);
  const std::string manifest_path = root + maps::kManifestName;
  check_size(name + ": " + maps::kManifestName, found.files.at(manifest_path).bytes);
  const std::string text = maps::read_text(unpacked / manifest_path);
  const maps::MapManifest manifest = maps::parse_manifest(text, name + ": " + maps::kManifestName);
  CopiedPackage package{.digest = maps::sha256_of(text), .bytes = text.size()};
  if (package.digest != found.files.at(manifest_path).sha256)
    throw maps::StorageError((unpacked / manifest_path).string(),
                             "reads back other than it was written");

  take_known(manifest, known, root, unpacked, disk, found);
  std::set<std::string> kept = {manifest_path};
  std::map<std::string_view, std::uint64_t> of_kind;
  for (const auto& [path, listed] : manifest.files) {
    check_listed(path, listed, root, found, name);
    if (path == maps::kGraphName) check_size(fmt::format("{}: {}", name, path), listed.bytes);
    // Those of all drives are read together.
    for (const char* kind : {"objects", "disagreement", "trajectory"})
      if (path.starts_with(kind))
        check_size(fmt::format("{}: {}", name, path), of_kind[kind] += listed.bytes);
    kept.insert(root + path);
    package.bytes += listed.bytes;
  }
  const auto build = found.files.find(root + maps::kBuildName);
  if (build != found.files.end()) {
    check_size(name + ": " + maps::kBuildName, build->second.bytes, kLargestBuildJson);
    kept.insert(build->first);
  }
  const fs::path place = root.empty() ? unpacked : (unpacked / root).parent_path();
  const auto signatures = signatures_beside(place);
  const std::set<std::string> folders = drop_others(unpacked, found, kept, root, disk);
  for (const std::string& path : kept) disk.sync_file(unpacked / path);
  for (const std::string& folder : folders) disk.sync_folder(unpacked / folder);
  disk.sync_folder(unpacked);
  return {place, std::move(package), signatures};
}

}  // namespace stillmap::server

#include "jobs/job_sources.hpp"

#include <spdlog/spdlog.h>

#include <stillmap/maps/error.hpp>
#include "store/package_copy.hpp"
#include "store/package_hold.hpp"

#include <filesystem>
#include <optional>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// Digest of the version whose frame the new map is brought into, where it is brought into one.
std::optional<std::string> active_digest(const PackageStore& store, const std::string& map,
                                         const RebuildRequest& request) {
  if (request.new_frame) return std::nullopt;
  const std::optional<std::string> active = store.state().map(map).active;
  if (!active) return std::nullopt;
  return store.state().version(map, *active).digest;
}

RebuildSources drives_of(const DriveStore& drives, const RebuildRequest& request) {
  RebuildSources sources;
  for (const std::int64_t id : request.drives) sources.drives.push_back(drives.folder(id));
  if (request.held_back) sources.held_back = drives.folder(*request.held_back);
  return sources;
}

void copy_whole(const fs::path& package, const fs::path& folder) {
  const DurableFiles files(DiskCalls::real());
  const fs::path half = folder.string() + ".new";
  if (fs::exists(half)) files.remove_tree(half);
  files.make_folder(half);
  (void)copy_package(package, half, files);
  files.rename(half, folder);
}

/// Where a job reads a package that may be removed meanwhile: what it reads must stay.
fs::path held(const PackageStore& store, const std::string& digest, const fs::path& folder) {
  if (fs::exists(folder)) return folder;
  const PackageBlobs::Local local = store.local(digest);
  const fs::path& package = local.folder;
  try {
    if (hold_package(package, folder)) return folder;
    if (local.pin) {
      // It may leave this disk before the job ends.
      copy_whole(package, folder);
      return folder;
    }
    spdlog::info("{}: on another disk, so that it must stay where it is", package.string());
  } catch (const maps::StorageError& error) {
    spdlog::warn("{} must stay where it is: {}", package.string(), error.what());
  }
  return package;
}

/// As of when the job began: an attempt goes on only with what the one before had.
fs::path previous_of(const JobFolder& folder, const PackageStore& store,
                     const std::string& active) {
  const fs::path own = folder.scratch() / "previous-map";
  const std::optional<std::string> noted = read_small_file(folder.previous());
  const bool goes_on = noted && (fs::exists(own) || store.state().uses(*noted));
  if (!goes_on) clear_folder(own);
  const std::string digest = goes_on ? *noted : active;
  write_small_file(folder.previous(), digest);
  return held(store, digest, own);
}

}  // namespace

RebuildSources sources_now(const JobSetup& setup, const std::string& map,
                           const RebuildRequest& request) {
  RebuildSources sources = drives_of(setup.drives, request);
  if (const auto active = active_digest(setup.store, map, request))
    sources.previous = setup.store.local(*active).folder;
  return sources;
}

RebuildSources sources_of_job(const JobSetup& setup, const std::string& map,
                              const RebuildRequest& request, const JobFolder& folder) {
  RebuildSources sources = drives_of(setup.drives, request);
  if (const auto active = active_digest(setup.store, map, request))
    sources.previous = previous_of(folder, setup.store, *active);
  return sources;
}

}  // namespace stillmap::server

#include "jobs/job_runner.hpp"

#include <spdlog/spdlog.h>

#include <stillmap/maps/error.hpp>
#include "store/package_hold.hpp"

#include <filesystem>
#include <optional>
#include <string>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// Where a job reads the version that its map is brought into the frame of: it may be removed
/// meanwhile, and what is read of it must stay.
fs::path held(const fs::path& package, const fs::path& folder) {
  if (fs::exists(folder)) return folder;
  try {
    if (hold_package(package, folder)) return folder;
    spdlog::info("{}: on another disk, so that it must stay where it is", package.string());
  } catch (const maps::StorageError& error) {
    spdlog::warn("{} must stay where it is: {}", package.string(), error.what());
  }
  return package;
}

/// As of when the job began: an attempt goes on only with what the one before had, whatever was
/// activated meanwhile.
fs::path previous_of(const JobFolder& folder, const PackageStore& store,
                     const std::string& active) {
  const fs::path own = folder.scratch() / "previous-map";
  const std::optional<std::string> noted = read_small_file(folder.previous());
  const bool goes_on = noted && (fs::exists(own) || store.state().uses(*noted));
  if (!goes_on) clear_folder(own);
  const std::string digest = goes_on ? *noted : active;
  write_small_file(folder.previous(), digest);
  return held(store.folder() / "packages" / digest, own);
}

}  // namespace

RebuildSources JobRunner::sources_of(const StoredJob& job, const RebuildRequest& request) const {
  RebuildSources sources;
  for (const std::int64_t id : request.drives) sources.drives.push_back(setup_.drives.folder(id));
  if (request.held_back) sources.held_back = setup_.drives.folder(*request.held_back);
  if (request.new_frame) return sources;
  const StoredMap map = setup_.store.state().map(job.map);
  if (!map.active) return sources;
  const std::string active = setup_.store.state().version(map.name, *map.active).digest;
  sources.previous = job.id > 0 ? previous_of(folder(job.id), setup_.store, active)
                                : setup_.store.folder() / "packages" / active;
  return sources;
}

}  // namespace stillmap::server

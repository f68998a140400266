#pragma once

#include <stillmap/maps/drive.hpp>
#include "store/drive_store.hpp"
#include "store/package_store.hpp"
#include "store/store_upkeep.hpp"

#include <cstddef>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "support/disk_calls.hpp"
#include "support/tar_bytes.hpp"

/// What a store holds, and whether what is left of one after a crash is whole.
namespace stillmap::test {

/// All that a store has acknowledged, as text.
inline std::string contents_of(const server::PackageStore& store) {
  constexpr std::size_t kMost = 1000;
  std::string text;
  for (const server::StoredMap& map : store.state().maps()) {
    text += map.name + "@" + std::to_string(map.revision) + " active " +
            map.active.value_or("none") + " previous " + map.previous.value_or("none");
    for (const server::StoredVersion& version : store.state().versions(map.name)) {
      text += " " + version.name + "=" + version.digest.substr(0, 6);
      for (const auto& each : store.state().signatures().of(map.name, version.digest))
        text += " signed by " + each.key.substr(0, 6);
    }
    text += "\n";
    for (const server::StoredDrive& drive : store.state().drives().of_map(map.name))
      text += "drive " + drive.name + " " + std::string(name_of(drive.status)) + " " +
              std::to_string(drive.bytes) + "\n";
    for (const server::StoredDrive& upload : store.state().drives().uploads_of_map(map.name))
      text += "upload " + upload.target.version + " " + std::string(name_of(upload.status)) + " " +
              std::to_string(upload.bytes) + "\n";
    const server::SavedEdits edits = store.state().edits().of_map(map.name);
    if (edits.saved_ns) text += "edits " + edits.text + " by " + edits.saver + "\n";
  }
  for (const server::ApiKey& key : store.state().keys().list())
    text += "key " + key.name + (key.revoked_ns ? " revoked\n" : "\n");
  for (const server::StoredJob& job : store.state().jobs().list({}, kMost).jobs)
    text += "job " + std::to_string(job.id) + " " + std::string(name_of(job.status)) + " " +
            job.stage + " " + std::to_string(job.attempts) +
            (job.cancel_requested ? " asked\n" : "\n");
  for (const server::AuditRecord& record : store.state().audit().list(kMost).records)
    text += "audit " + record.subject + "\n";
  return text;
}

/// A folder's files as entries of a tar.
inline std::string tar_of(const std::filesystem::path& folder, const std::string& prefix) {
  std::string tar;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    std::ifstream stream(entry.path(), std::ios::binary);
    const std::string bytes(std::istreambuf_iterator<char>(stream), {});
    tar += tar_file(prefix + entry.path().lexically_relative(folder).string(), bytes);
  }
  return tar;
}

/// Whether the bytes of every drive are there, and nothing else.
/// @return what is wrong; empty when all is well.
inline std::string drive_problem_of(const server::PackageStore& store,
                                    const server::DriveStore& drives) {
  std::size_t known = 0;
  for (const server::StoredDrive& drive : store.state().drives().all()) {
    const std::filesystem::path home = drives.folder(drive.id).parent_path();
    known += std::filesystem::exists(home) ? 1U : 0U;
    if (drive.status == server::DriveStatus::kComplete && !drive.is_upload())
      (void)maps::Drive::open(drives.folder(drive.id));
    if (drive.status == server::DriveStatus::kNeedsChoice &&
        !maps::Drive::is_in(drives.folder(drive.id)))
      return drive.name + ": the recording is gone";
    if (drive.status != server::DriveStatus::kOpen) continue;
    for (const server::DrivePart& part : store.state().drives().parts(drive.id))
      if (std::filesystem::file_size(home / "parts" / std::to_string(part.n)) != part.bytes)
        return drive.name + ": a part of another size";
  }
  const std::filesystem::directory_iterator folders(store.folder() / "drives");
  const auto count = static_cast<std::size_t>(std::distance(begin(folders), end(folders)));
  return count == known ? "" : "folders of drives that no row names";
}

/// Opens what is left of a store.
/// @param acknowledged, next  contents as of the last change that returned, and with the one after.
/// @param later  a package that is published afterwards.
/// @return what is wrong: something acknowledged is lost, something else is there, or a package
/// is broken; empty when all is well.
inline std::string problem_of(const std::filesystem::path& folder, const std::string& acknowledged,
                              const std::string& next, const std::filesystem::path& later) {
  UnsyncedCalls calls;
  try {
    server::PackageStore store(folder, calls);
    const std::string contents = contents_of(store);
    if (contents != acknowledged && contents != next)
      return "found\n" + contents + "expected\n" + acknowledged;
    if (!verify_store(store).empty()) return verify_store(store).front().what;
    if (!store.not_cleared_because().empty()) return store.not_cleared_because();
    const server::DriveStore drives(store, calls);
    if (std::string problem = drive_problem_of(store, drives); !problem.empty()) return problem;
    clear_unused(store);
    if (!unnamed_packages(store).empty()) return "packages that no version names";
    store.add("later", "a", later);
    store.activate("later", "a");
    if (!verify_store(store).empty()) return "after adding: " + verify_store(store).front().what;
    return {};
  } catch (const std::exception& error) {
    return error.what();
  }
}

}  // namespace stillmap::test

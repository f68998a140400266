#include "store/drive_store.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/recording_choice.hpp>
#include <stillmap/maps/text.hpp>
#include "store/drive_table.hpp"
#include "store/received_file.hpp"

#include <algorithm>
#include <charconv>
#include <exception>
#include <vector>

#include "store/durable_files.hpp"
#include "store/store_folder.hpp"

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

constexpr const char* kDrivesName = "drives";
constexpr const char* kPartsName = "parts";
/// KITTI's, in the folder of a day above its drives.
constexpr const char* kKittiCalibration = "calib_imu_to_velo.txt";
/// Where an archive is unpacked, before it is known to be a drive.
constexpr const char* kUnpackedName = ".incoming-drive";

std::optional<std::int64_t> id_of(const std::string& name) {
  std::int64_t id = 0;
  const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), id);
  if (error != std::errc{} || end != name.data() + name.size() || id < 0) return std::nullopt;
  return id;
}

bool has_part(const std::vector<DrivePart>& parts, std::int64_t n) {
  return std::any_of(parts.begin(), parts.end(), [&](const auto& part) { return part.n == n; });
}

void refuse_if_not_open(const StoredDrive& drive) {
  if (drive.status == DriveStatus::kOpen) return;
  throw StoreRefusal(
      StoreRefusal::Reason::kDriveNotOpen,
      drive_name(drive) + (drive.status == DriveStatus::kNeedsChoice
                               ? ": its upload has ended; it needs a choice of topics"
                               : " is " + std::string(name_of(drive.status))));
}

void refuse_if_too_large(const StoredDrive& drive, std::uint64_t bytes, std::uint64_t most,
                         const std::string& part) {
  if (bytes <= most && drive.bytes <= most - bytes) return;
  throw maps::InputError(part,
                         std::to_string(bytes) + " bytes more than " + std::to_string(drive.bytes),
                         "at most " + std::to_string(most) + " in all");
}

/// Asked for again with the same choice, a drive that is complete stays so.
void refuse_other_choice(const StoredDrive& drive, const fs::path& folder,
                         const std::string& choice) {
  if (choice.empty()) return;
  const fs::path file = folder / kTopicsFile;
  std::string made;
  if (maps::takes_recording_choice(folder) && is_there(file))
    made = maps::merged_recording_choice(maps::read_text(file), {}, file.string());
  if (!made.empty() && maps::merged_recording_choice(choice, made, "choice") == made) return;
  throw StoreRefusal(StoreRefusal::Reason::kDriveNotOpen,
                     drive_name(drive) + " is complete already, " +
                         (made.empty() ? "without a choice" : "with " + made) +
                         ": to choose anew, upload it again");
}

/// A file that goes unless it was renamed.
class Leftover {
 public:
  Leftover(fs::path path, const DurableFiles& files) : path_(std::move(path)), files_(&files) {}
  ~Leftover() {
    try {
      if (is_there(path_)) files_->remove_file(path_);
    } catch (const std::exception&) {
      // The next open clears it.
    }
  }
  Leftover(const Leftover&) = delete;
  Leftover& operator=(const Leftover&) = delete;

 private:
  fs::path path_;
  const DurableFiles* files_;
};

}  // namespace

DriveStore::Found DriveStore::looked_at(const OpenedDrive& opened, const Inspect& inspect) {
  const std::scoped_lock lock(inspecting_);
  Found found = inspect ? inspect(opened) : Found{};
  if (opened.needs_choice) found.needs_choice = opened.needs_choice->what();
  return found;
}

/// While it lives nobody else changes this drive.
class DriveStore::Busy {
 public:
  Busy(DriveStore& drives, std::int64_t id) : drives_(&drives), id_(id) {
    std::unique_lock lock(drives_->mutex_);
    drives_->changed_.wait(lock, [&] { return !drives_->busy_.contains(id_); });
    drives_->busy_.insert(id_);
  }
  ~Busy() {
    const std::scoped_lock lock(drives_->mutex_);
    drives_->busy_.erase(id_);
    drives_->changed_.notify_all();
  }
  Busy(const Busy&) = delete;
  Busy& operator=(const Busy&) = delete;

 private:
  DriveStore* drives_;
  std::int64_t id_;
};

DriveStore::DriveStore(PackageStore& store, DiskCalls& calls)
    : store_(store), calls_(&calls), drives_(store.folder() / kDrivesName) {
  if (!store_.read_only_because().empty()) return;
  try {
    const DurableFiles files(*calls_);
    if (files.make_folder(drives_)) files.sync_folder(store_.folder());
    clear_leftovers();
  } catch (const maps::StorageError&) {
    // A full or failing disk must not keep maps from being served; what comes will say so.
  }
}

fs::path DriveStore::home(std::int64_t id) const { return drives_ / std::to_string(id); }
/// By the drive's number, since maps and edits tell drives apart by the names of their folders.
fs::path DriveStore::folder(std::int64_t id) const {
  return home(id) / ("drive-" + std::to_string(id));
}

/// A name that nothing has, in the folder of the drive's parts.
fs::path DriveStore::make_incoming(std::int64_t id) {
  const DurableFiles files(*calls_);
  const Busy busy(*this, id);
  refuse_if_not_open(store_.drives().drive(id));
  const fs::path parts = home(id) / kPartsName;
  if (files.make_folder(home(id))) files.sync_folder(drives_);
  if (files.make_folder(parts)) files.sync_folder(home(id));
  const std::scoped_lock lock(mutex_);
  return parts / (kIncoming + std::to_string(incoming_++));
}

DriveStore::Added DriveStore::add_part(std::int64_t id, const IncomingPart& wanted,
                                       const Limits& limits) {
  const StoredDrive drive = store_.drives().drive(id);
  const std::int64_t n = wanted.n;
  const std::uint64_t bytes = wanted.bytes;
  const std::string name = drive_name(drive) + " part " + std::to_string(n);
  if (n < 1 || n > DriveTable::kMostParts)
    throw std::invalid_argument(name + ": 1 to " + std::to_string(DriveTable::kMostParts));
  if (!has_part(store_.drives().parts(id), n)) {
    refuse_if_too_large(drive, bytes, limits.bytes, name);
    store_.check_quota(drive.map, bytes);
  }
  const DurableFiles files(*calls_);
  const fs::path incoming = make_incoming(id);
  const Leftover leftover(incoming, files);
  const DrivePart part{
      .n = n,
      .sha256 = receive_file(store_.leaving_reserve(wanted.source), bytes, incoming, name, *calls_),
      .bytes = bytes};
  if (wanted.sha256 && *wanted.sha256 != part.sha256)
    throw maps::InputError(name, "SHA-256 " + part.sha256,
                           *wanted.sha256 + " as announced: send the part again");
  const Busy busy(*this, id);
  const StoredDrive now = store_.drives().drive(id);
  refuse_if_not_open(now);
  const bool is_new = !has_part(store_.drives().parts(id), n);
  const fs::path placed = home(id) / kPartsName / std::to_string(n);
  if (is_new) {
    // Others may have come meanwhile.
    refuse_if_too_large(now, bytes, limits.bytes, name);
    files.rename(incoming, placed);
    files.sync_folder(placed.parent_path());
  }
  try {
    // Refuses another digest, and what passes the quota together with what came meanwhile.
    store_.drives().add_part(id, part, store_.quota());
  } catch (const StoreRefusal&) {
    if (is_new) files.remove_file(placed);
    throw;
  }
  return {part, is_new};
}

StoredDrive DriveStore::complete(std::int64_t id, const Completion& wanted) {
  const Busy busy(*this, id);
  const StoredDrive drive = store_.drives().drive(id);
  if (drive.is_upload())
    throw StoreRefusal(StoreRefusal::Reason::kUnknownDrive,
                       "drive " + std::to_string(id) + " is an upload of a version");
  if (drive.status == DriveStatus::kNeedsChoice) return choose(drive, wanted);
  if (drive.status == DriveStatus::kComplete) refuse_other_choice(drive, folder(id), wanted.choice);
  StoredDrive done = unpack(drive, wanted);
  const fs::path parts = home(id) / kPartsName;
  if (is_there(parts)) DurableFiles(*calls_).remove_tree(parts);
  return done;
}

/// Of a drive that is not complete: its parts become a drive, or it fails.
StoredDrive DriveStore::unpack(const StoredDrive& drive, const Completion& wanted) {
  // `complete` refuses gaps, and what has failed.
  if (drive.status != DriveStatus::kOpen || parts_of(drive.id).empty())
    return store_.drives().complete(drive.id, now_ns());
  try {
    return note(drive.id, extract(drive.id, wanted));
  } catch (const ChoiceRefused&) {
    throw;  // without a choice it may be a drive
  } catch (const maps::InputError& error) {
    store_.drives().fail(drive.id, error.what(), now_ns());
    DurableFiles(*calls_).remove_tree(home(drive.id));
    throw;
  }
}

/// Of a drive that needs a choice, which it keeps as long as no choice opens it.
StoredDrive DriveStore::choose(const StoredDrive& drive, const Completion& wanted) {
  if (wanted.choice.empty()) return drive;
  try {
    const OpenedDrive opened = open_drive_folder(folder(drive.id), wanted.choice);
    const Found found = looked_at(opened, wanted.inspect);
    if (found.needs_choice.empty()) keep_choice(folder(drive.id), wanted.choice, *calls_);
    return note(drive.id, found);
  } catch (const maps::InputError& error) {
    return store_.drives().ask_for_choice(drive.id, error.what(), drive.inspection);
  }
}

StoredDrive DriveStore::note(std::int64_t id, const Found& found) {
  if (found.needs_choice.empty()) return store_.drives().complete(id, now_ns(), found.inspection);
  return store_.drives().ask_for_choice(id, found.needs_choice, found.inspection);
}

StoredDrive DriveStore::complete_upload(std::int64_t id, const Take& take) {
  const Busy busy(*this, id);
  const StoredDrive upload = store_.drives().drive(id);
  if (!upload.is_upload())
    throw StoreRefusal(StoreRefusal::Reason::kUnknownDrive,
                       "drive " + std::to_string(id) + " is no upload of a version");
  if (upload.status == DriveStatus::kOpen) {
    const std::vector<fs::path> parts = parts_of(id);
    if (!parts.empty()) {  // `complete` refuses gaps
      try {
        take(concatenated(parts), upload.bytes);
      } catch (const maps::InputError& error) {
        store_.drives().fail(id, error.what(), now_ns());
        DurableFiles(*calls_).remove_tree(home(id));
        throw;
      }
    }
  }
  StoredDrive done = store_.drives().complete(id, now_ns());
  if (is_there(home(id))) DurableFiles(*calls_).remove_tree(home(id));
  return done;
}

/// Files of the parts in their order; none when there is a gap.
std::vector<fs::path> DriveStore::parts_of(std::int64_t id) const {
  std::vector<fs::path> parts;
  for (const DrivePart& part : store_.drives().parts(id)) {
    if (part.n != static_cast<std::int64_t>(parts.size()) + 1) return {};
    parts.push_back(home(id) / kPartsName / std::to_string(part.n));
  }
  return parts;
}

/// Of an open drive that nobody else changes, with all its parts.
DriveStore::Found DriveStore::extract(std::int64_t id, const Completion& wanted) {
  const DurableFiles files(*calls_);
  // Of an attempt that a full disk ended after the drive was in its place.
  if (is_there(folder(id))) files.remove_tree(folder(id));
  const fs::path unpacked = home(id) / kUnpackedName;
  if (is_there(unpacked)) files.remove_tree(unpacked);
  const ExtractedDrive drive = extract_drive({store_.leaving_reserve(concatenated(parts_of(id))),
                                              "drive " + std::to_string(id), wanted.limits.archive},
                                             unpacked, *calls_, wanted.choice);
  // While the drive's files are where it was opened.
  Found found = looked_at(drive.opened, wanted.inspect);
  if (found.needs_choice.empty()) keep_choice(drive.root, wanted.choice, *calls_);
  // What a drive has beside it stays beside it.
  const fs::path beside = drive.root.parent_path() / kKittiCalibration;
  if (drive.root != unpacked && is_there(beside))
    files.rename(beside, home(id) / kKittiCalibration);
  files.rename(drive.root, folder(id));
  if (drive.root != unpacked) files.remove_tree(unpacked);
  files.sync_folder(home(id));
  return found;
}

void DriveStore::remove(std::int64_t id) {
  const Busy busy(*this, id);
  // Without a row it is nothing, so the rest may follow at the next open.
  store_.drives().remove(id);
  if (is_there(home(id))) DurableFiles(*calls_).remove_tree(home(id));
}

/// Whatever no row speaks for, and halves of what was under way.
void DriveStore::clear_leftovers() {
  const DurableFiles files(*calls_);
  const std::vector<StoredDrive> known = store_.drives().all();
  for (const std::string& name : folders_in(drives_)) {
    const std::optional<std::int64_t> id = id_of(name);
    const auto drive = std::find_if(known.begin(), known.end(),
                                    [&](const StoredDrive& each) { return each.id == id; });
    const bool keeps_nothing = drive == known.end() || drive->status == DriveStatus::kFailed ||
                               (drive->is_upload() && drive->status == DriveStatus::kComplete);
    if (keeps_nothing) {
      files.remove_tree(drives_ / name);
      continue;
    }
    const bool open = drive->status == DriveStatus::kOpen;
    const fs::path parts = drives_ / name / kPartsName;
    if (!open && is_there(parts)) files.remove_tree(parts);
    const fs::path unpacked = drives_ / name / kUnpackedName;
    if (is_there(unpacked)) files.remove_tree(unpacked);
    if (open && is_there(folder(*id))) files.remove_tree(folder(*id));
    if (!open || !is_there(parts)) continue;
    for (const auto& entry : fs::directory_iterator(parts))
      if (entry.path().filename().string().starts_with(kIncoming)) files.remove_file(entry.path());
  }
}

}  // namespace stillmap::server

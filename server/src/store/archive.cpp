#include "store/archive.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/text.hpp>

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <exception>
#include <memory>
#include <set>
#include <system_error>
#include <utility>

#include "store/archive_files.hpp"
#include "store/durable_files.hpp"

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// A folder that goes when it is not kept.
class TargetFolder {
 public:
  TargetFolder(const fs::path& folder, const DurableFiles& disk)
      : folder_(fs::absolute(folder).lexically_normal()), disk_(&disk) {
    if (!disk_->make_folder(folder_))
      throw maps::StorageError(folder_.string(), "is there already");
  }
  ~TargetFolder() {
    if (kept_) return;
    try {
      disk_->remove_tree(folder_);
    } catch (const std::exception&) {
      // The error that brought us here says more.
    }
  }
  TargetFolder(const TargetFolder&) = delete;
  TargetFolder& operator=(const TargetFolder&) = delete;

  [[nodiscard]] const fs::path& path() const { return folder_; }
  void sync(const std::set<std::string>& folders) const {
    for (const std::string& folder : folders) disk_->sync_folder(folder_ / folder);
    disk_->sync_folder(folder_);
    disk_->sync_folder(folder_.parent_path());
  }
  void keep() { kept_ = true; }

 private:
  fs::path folder_;
  const DurableFiles* disk_;
  bool kept_ = false;
};

/// Where the drive starts: an archive of a folder has that folder in it, KITTI's the day's above.
/// @return the target itself when there is no drive.
fs::path drive_root(const fs::path& target) {
  for (fs::path root = target;;) {
    if (maps::Drive::is_in(root)) return root;
    std::vector<fs::path> folders;
    std::error_code error;
    fs::directory_iterator entry(root, error);
    for (; !error && entry != fs::directory_iterator(); entry.increment(error))
      if (entry->is_directory()) folders.push_back(entry->path());
    if (error) throw maps::StorageError(root.string(), error.message());
    if (folders.size() != 1) return target;
    root = folders.front();
  }
}

maps::Drive opened_with(const fs::path& root, const std::string& choice) {
  maps::Drive drive = maps::Drive::open(root.string() + (choice.empty() ? "" : "?" + choice));
  if (drive.size() == 0)
    throw maps::InputError(root.string(), "a drive without scans",
                           "one scan at least: pack the folder that holds the scans");
  return drive;
}

/// What can be chosen of a recording that was refused; nothing if no choice opens it.
std::optional<std::vector<maps::RecordingTopic>> topics_of_recording(const fs::path& root) {
  // Whatever is wrong with the rest, the clouds can be read so.
  const std::string easiest = "poses=none&imu=none&points=sensor&stamps=recorded";
  try {
    return topic_of_clouds(opened_with(root, easiest));
  } catch (const maps::ChoiceError& error) {
    return error.topics();
  } catch (const maps::InputError&) {
    return std::nullopt;
  }
}

/// The files behind `concatenated`.
class Parts {
 public:
  explicit Parts(std::vector<fs::path> files) : files_(std::move(files)) {}
  ~Parts() { close(); }
  Parts(const Parts&) = delete;
  Parts& operator=(const Parts&) = delete;

  std::size_t read(std::span<char> into) {
    while (at_ < files_.size()) {
      if (descriptor_ < 0) open();
      const ssize_t got = ::read(descriptor_, into.data(), into.size());
      if (got > 0) return static_cast<std::size_t>(got);
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) fail();
      close();
      ++at_;
    }
    return 0;
  }

 private:
  [[noreturn]] void fail() const {
    throw maps::StorageError(files_[at_].string(), std::strerror(errno));
  }
  void open() {
    descriptor_ = ::open(files_[at_].c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
    if (descriptor_ < 0) fail();
  }
  void close() {
    if (descriptor_ >= 0) ::close(descriptor_);
    descriptor_ = -1;
  }

  std::vector<fs::path> files_;
  std::size_t at_ = 0;
  int descriptor_ = -1;
};

}  // namespace

ExtractedArchive extract_archive(const IncomingArchive& archive, const fs::path& target,
                                 DiskCalls& calls) {
  const DurableFiles disk(calls);
  TargetFolder folder(target, disk);
  const ArchiveFiles found = unpack_archive(archive, folder.path(), disk, /*hashed=*/false);
  folder.sync(found.folders);
  folder.keep();
  return found.archive;
}

ByteSource concatenated(std::vector<fs::path> files) {
  return [parts = std::make_shared<Parts>(std::move(files))](std::span<char> into) {
    return parts->read(into);
  };
}

OpenedDrive open_drive_folder(const fs::path& root, const std::string& choice) {
  const bool is_recording = maps::takes_recording_choice(root);
  if (!choice.empty() && !is_recording)
    throw ChoiceRefused(root.string(),
                        "the choice '" + choice + "' for a drive that is no recording",
                        "no choice: leave it out");
  OpenedDrive opened;
  try {
    opened.drive = opened_with(root, choice);
  } catch (const maps::ChoiceError& error) {
    opened.needs_choice = error;
  } catch (const maps::InputError& error) {
    if (!is_recording) throw;
    const auto topics = topics_of_recording(root);
    // A wrong choice must not lose what was uploaded, wherever it was made.
    if (!topics && choice.empty() && !fs::exists(root / kTopicsFile)) throw;
    opened.needs_choice.emplace(error, topics.value_or(std::vector<maps::RecordingTopic>{}));
  }
  return opened;
}

void keep_choice(const fs::path& root, const std::string& choice, DiskCalls& calls) {
  if (choice.empty()) return;
  const DurableFiles disk(calls);
  const fs::path own = root / kTopicsFile, half = root / ".incoming-topics";
  const std::string words = maps::merged_recording_choice(
      choice, fs::exists(own) ? maps::read_text(own) : "", own.string());
  if (fs::exists(half)) disk.remove_file(half);
  DurableFiles::NewFile file = disk.create(half);
  file.append(words);
  file.finish();
  disk.rename(half, own);
  disk.sync_folder(root);
}

std::vector<maps::RecordingTopic> topic_of_clouds(const maps::Drive& opened) {
  const maps::Drive::Contents::Entries& entries = opened.contents().entries;
  return {{.word = "cloud",
           .name = entries.topic,
           .type = {},
           .messages = opened.size(),
           .frame_id = entries.frame_id}};
}

ExtractedDrive extract_drive(const IncomingArchive& archive, const fs::path& target,
                             DiskCalls& calls, const std::string& choice) {
  const DurableFiles disk(calls);
  TargetFolder folder(target, disk);
  const ArchiveFiles found = unpack_archive(archive, folder.path(), disk, /*hashed=*/false);
  ExtractedDrive drive{.root = drive_root(folder.path()), .opened = {}, .archive = found.archive};
  drive.opened = open_drive_folder(drive.root, choice);
  folder.sync(found.folders);
  folder.keep();
  return drive;
}

}  // namespace stillmap::server

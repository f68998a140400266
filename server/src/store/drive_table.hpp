#pragma once

#include "store/store_quota.hpp"
#include "store/store_refusal.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

class StoreDatabase;

/// open -> needs_choice | complete | failed; needs_choice -> complete.
enum class DriveStatus : std::uint8_t { kOpen, kNeedsChoice, kComplete, kFailed };
/// "open", "needs_choice", "complete", "failed".
[[nodiscard]] std::string_view name_of(DriveStatus status);

/// An uploaded part of a drive.
struct DrivePart {
  /// 1 to 10,000, in the order of the bytes.
  std::int64_t n = 0;
  /// Hex.
  std::string sha256{};
  std::uint64_t bytes = 0;
  auto operator<=>(const DrivePart&) const = default;
};

/// What the bytes of an upload are to become.
struct UploadTarget {
  /// Name of a version of its map; empty for a drive.
  std::string version{};
  /// Media type of the bytes.
  std::string content_type{};
  auto operator<=>(const UploadTarget&) const = default;
};

/// A drive, or a version of a map, that comes in parts.
struct StoredDrive {
  /// Grows with time, never given twice: safe as the name of a folder.
  std::int64_t id = 0;
  std::string map{};
  /// As the uploader called it; not unique.
  std::string name{};
  DriveStatus status = DriveStatus::kOpen;
  /// Why it failed, or which choice it needs; else empty.
  std::string error{};
  /// What was found in it, as its completer wrote it; empty where nobody looked.
  std::string inspection{};
  /// Of its parts.
  std::uint64_t bytes = 0;
  std::int64_t created_ns = 0;
  /// When it was completed or failed.
  std::optional<std::int64_t> finished_ns{};
  /// Of an upload that becomes a version.
  UploadTarget target{};
  /// The server in whose folder its bytes are; empty where that is not known.
  std::string files_at{};
  [[nodiscard]] bool is_upload() const { return !target.version.empty(); }
  auto operator<=>(const StoredDrive&) const = default;
};
/// "drive 3" or "upload 3", as refusals name it.
[[nodiscard]] std::string drive_name(const StoredDrive& drive);

/// Uploaded drives of a store, and versions on their way in; their bytes lie where the caller keeps
/// them, synced before the row that says so is made, and are cleared after the row is gone. What
/// returned is kept. Safe from several threads. Throws StorageError when the disk fails,
/// StoreRefusal kUnknownDrive for an id that is none.
class DriveTable {
 public:
  static constexpr std::int64_t kMostParts = 10'000;

  /// @param files_at  the server that keeps its bytes. @throws StoreRefusal kUnknownMap.
  StoredDrive open(std::string_view map, std::string_view name, std::int64_t now_ns,
                   std::string_view files_at = {});
  /// An upload that becomes a version; a complete one takes no room, and goes with its map.
  /// @param target  whose version is `is_valid_map_name`.
  /// @throws StoreRefusal kUnknownMap; std::invalid_argument.
  StoredDrive open_upload(std::string_view map, const UploadTarget& target, std::int64_t now_ns,
                          std::string_view files_at = {});
  /// @return false when the same part is there already. @throws StoreRefusal kDriveNotOpen,
  /// kOtherDigest, kOverQuota; std::invalid_argument for a number or digest that is none.
  bool add_part(std::int64_t id, const DrivePart& part, const StoreQuota& quota = {});
  /// In order.
  [[nodiscard]] std::vector<DrivePart> parts(std::int64_t id) const;
  /// What is complete already stays so. @throws StoreRefusal kDriveNotOpen when it failed,
  /// kPartsMissing when there are none or there is a gap.
  StoredDrive complete(std::int64_t id, std::int64_t now_ns, std::string_view inspection = "");
  /// Its bytes are a drive only once more is chosen. It takes no more parts.
  /// @param error  which choice. @throws StoreRefusal kDriveNotOpen when it is complete or failed,
  /// kPartsMissing.
  StoredDrive ask_for_choice(std::int64_t id, std::string_view error, std::string_view inspection);
  /// @throws StoreRefusal kDriveNotOpen.
  StoredDrive fail(std::int64_t id, std::string_view error, std::int64_t now_ns);

  [[nodiscard]] StoredDrive drive(std::int64_t id) const;
  /// Drives, oldest first. @throws StoreRefusal kUnknownMap.
  [[nodiscard]] std::vector<StoredDrive> of_map(std::string_view map) const;
  /// Uploads that become versions, oldest first. @throws StoreRefusal kUnknownMap.
  [[nodiscard]] std::vector<StoredDrive> uploads_of_map(std::string_view map) const;
  /// Both, of all maps, oldest first: what else lies on the disk belongs to nobody.
  [[nodiscard]] std::vector<StoredDrive> all() const;
  /// Jobs that were enqueued with it, oldest first.
  [[nodiscard]] std::vector<std::int64_t> jobs_using(std::int64_t id) const;
  /// With its parts. @throws StoreRefusal kInUse while a job that is not finished reads it.
  void remove(std::int64_t id);

 private:
  friend class StoreState;
  explicit DriveTable(StoreDatabase& database) : database_(&database) {}
  StoreDatabase* database_;
};

}  // namespace stillmap::server

#pragma once

#include "store/archive.hpp"
#include "store/package_store.hpp"

#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// Drives that came in parts, for rebuilds, and uploads that become versions: the bytes behind a
/// store's `DriveTable`, in
/// `<store>/drives/<id>/`, kept in step with it as packages are with theirs (server/store.md). A
/// change that returned is kept. Safe from several threads; one process at a time receives drives.
class DriveStore {
 public:
  /// Makes the folder when it is missing, and clears what a killed process left.
  /// @param store  outlives this. @param calls  outlives this.
  explicit DriveStore(PackageStore& store, DiskCalls& calls = DiskCalls::real());

  /// Where a complete drive lies; it need not be there any more.
  [[nodiscard]] std::filesystem::path folder(std::int64_t id) const;

  /// What an archive of a whole drive may be.
  struct Limits {
    /// Of all parts together.
    std::uint64_t bytes = kUnbounded;
    ArchiveLimits archive{};
  };

  struct Added {
    DrivePart part;
    /// False when the same part was there already.
    bool is_new = false;
  };
  struct IncomingPart {
    std::int64_t n = 0;
    /// How many there are.
    std::uint64_t bytes = 0;
    ByteSource source;
    /// Lower-case hex, where that is known.
    std::optional<std::string> sha256{};
  };
  /// Keeps one part of the drive's archive.
  /// @throws StoreRefusal kUnknownDrive, kDriveNotOpen, kOtherDigest, kOverQuota; InputError for
  /// another SHA-256, fewer or more bytes, or too many in all; std::invalid_argument for a number
  /// beyond `DriveTable::kMostParts`.
  Added add_part(std::int64_t id, const IncomingPart& wanted, const Limits& limits);

  /// What an inspection says.
  struct Found {
    /// Which choice it needs; empty if none.
    std::string needs_choice;
    /// `StoredDrive::inspection`.
    std::string inspection;
  };
  /// Looks into a drive. Called for one drive at a time, since scans may be large.
  using Inspect = std::function<Found(const OpenedDrive&)>;
  struct Completion {
    Limits limits{};
    /// What is taken of a recording (`maps::check_recording_choice`), put into its `topics.txt`
    /// before the words that are there, once it opens the drive; empty leaves it as it came.
    std::string choice{};
    /// No inspection without it.
    Inspect inspect{};
  };
  /// Unpacks the parts, one after the other a tar (plain, gzip or zstd) of one drive, and lets go
  /// of them. A recording that needs a choice, or another one, is kept as it came, as kNeedsChoice;
  /// asked for again with a choice, it is opened again. What is complete already stays so.
  /// @throws ChoiceRefused, after which it may be asked for again without a choice; another
  /// InputError when they are none: the drive has then failed and its parts are gone;
  /// StoreRefusal kUnknownDrive, kDriveNotOpen, kPartsMissing; StorageError, after which it may be
  /// asked for again.
  StoredDrive complete(std::int64_t id, const Completion& wanted);
  /// Takes all bytes of an upload, one part after the other.
  using Take = std::function<void(const ByteSource& source, std::uint64_t bytes)>;
  /// Hands an upload to whoever publishes it, and lets go of its parts when that has returned.
  /// What is complete already is not handed on again.
  /// @throws what `take` throws: after an InputError it has failed and its parts are gone, after
  /// anything else it may be asked for again; StoreRefusal kUnknownDrive, kDriveNotOpen,
  /// kPartsMissing.
  StoredDrive complete_upload(std::int64_t id, const Take& take);
  /// With all that was kept of it. @throws StoreRefusal kUnknownDrive, kInUse.
  void remove(std::int64_t id);

 private:
  [[nodiscard]] std::filesystem::path home(std::int64_t id) const;
  class Busy;
  [[nodiscard]] std::filesystem::path make_incoming(std::int64_t id);
  [[nodiscard]] std::vector<std::filesystem::path> parts_of(std::int64_t id) const;
  Found looked_at(const OpenedDrive& opened, const Inspect& inspect);
  StoredDrive unpack(const StoredDrive& drive, const Completion& wanted);
  Found extract(std::int64_t id, const Completion& wanted);
  StoredDrive choose(const StoredDrive& drive, const Completion& wanted);
  StoredDrive note(std::int64_t id, const Found& found);
  void clear_leftovers();

  PackageStore& store_;
  DiskCalls* calls_;
  std::filesystem::path drives_;
  std::mutex mutex_;
  std::condition_variable changed_;
  /// Drives of which row and folder are changing together, one at a time; others go on meanwhile,
  /// since unpacking takes minutes.
  std::set<std::int64_t> busy_;
  std::uint64_t incoming_ = 0;
  /// Held while a drive is inspected.
  std::mutex inspecting_;
};

}  // namespace stillmap::server

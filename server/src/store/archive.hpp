#pragma once

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/recording_choice.hpp>
#include "store/disk_calls.hpp"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace stillmap::server {

/// Gives the next bytes of an archive: fills the front of the span, which is never empty, and says
/// how much of it; 0 at the end. It is asked up to its end, and what it throws ends the extraction
/// and comes out of it as it is: a digest of its own may be checked there.
using ByteSource = std::function<std::size_t(std::span<char>)>;

inline constexpr std::uint64_t kUnbounded = std::numeric_limits<std::uint64_t>::max();

/// A bound that somebody set; 0 is none.
[[nodiscard]] constexpr std::uint64_t bound_of(std::int64_t option) {
  return option > 0 ? static_cast<std::uint64_t>(option) : kUnbounded;
}

/// What an archive from outside may hold. Its size is bounded by the disk and the ratio, what of it
/// is kept in memory by the memory of the machine.
struct ArchiveLimits {
  /// Files and folders.
  std::uint64_t entries = kUnbounded;
  /// Of one file, unpacked.
  std::uint64_t file_bytes = kUnbounded;
  /// Of all, unpacked, headers and padding included.
  std::uint64_t total_bytes = kUnbounded;
  /// That the list of its entries takes in memory, some 300 bytes for each; 0 = a 16th of what
  /// there is.
  std::uint64_t list_bytes = 0;
  /// Unpacked to packed bytes, >= 1, beyond the first 16 MiB unpacked. Scans and tiles pack to a
  /// half at best, tables of text to a twentieth.
  double ratio = 100.0;
  /// Of a path inside the archive.
  std::size_t path_bytes = 240;
  /// Folders and the file itself.
  std::size_t depth = 8;
};

/// A tar from outside, on its way in.
struct IncomingArchive {
  ByteSource source;
  /// For messages.
  std::string name;
  ArchiveLimits limits{};
};

/// What lies in a folder now.
struct ExtractedArchive {
  std::uint64_t files = 0;
  /// Of all files.
  std::uint64_t bytes = 0;
  std::uint64_t packed_bytes = 0;
  /// Of the archive as it came, packed.
  std::string sha256;
};

/// Unpacks a tar (plain, gzip or zstd; ustar, GNU or pax headers) into a folder that does not exist
/// yet, and syncs all of it. The archive is never held: one buffer of it at most.
///
/// Only regular files and folders; names of printable ASCII without backslashes, "." and "..",
/// relative, each once. Owners, modes and times of the archive are ignored. What follows the end of
/// the archive must be zeros.
/// @throws InputError naming archive and entry for anything else, for a truncated archive and what
/// is beyond a limit; StorageError; std::invalid_argument for a broken limit. Nothing of the folder
/// is left then (but after a kill: give it a name that is cleared).
ExtractedArchive extract_archive(const IncomingArchive& archive,
                                 const std::filesystem::path& target,
                                 DiskCalls& calls = DiskCalls::real());

/// One after the other as if they were one file. Only one is open at a time.
/// @throws StorageError when read.
[[nodiscard]] ByteSource concatenated(std::vector<std::filesystem::path> files);

/// Of a recording's folder: what is taken of it (`maps::Drive::open`).
inline constexpr const char* kTopicsFile = "topics.txt";

/// A choice for a drive that takes none.
class ChoiceRefused : public maps::InputError {
 public:
  using InputError::InputError;
};

/// A drive that lies in a folder, or the choice that it needs to be one.
struct OpenedDrive {
  std::optional<maps::Drive> drive;
  std::optional<maps::ChoiceError> needs_choice;
};
/// @param choice  of a recording, before the words of its own `kTopicsFile`; none if empty. With
/// one, or with that file, a recording that cannot be opened always needs another.
/// @throws ChoiceRefused for a choice of a drive that is no recording; InputError when `Drive`
/// cannot open it with any choice, or it has no scan.
[[nodiscard]] OpenedDrive open_drive_folder(const std::filesystem::path& root,
                                            const std::string& choice);
/// Writes a choice that opens the folder into its `kTopicsFile`, synced. Words of the file that the
/// choice leaves open stay. Nothing if it is empty.
void keep_choice(const std::filesystem::path& root, const std::string& choice,
                 DiskCalls& calls = DiskCalls::real());
/// What is known to choose of a recording that was opened, for a `ChoiceError`.
[[nodiscard]] std::vector<maps::RecordingTopic> topic_of_clouds(const maps::Drive& opened);

struct ExtractedDrive {
  /// The target, or the single folder in it that holds the drive.
  std::filesystem::path root;
  OpenedDrive opened;
  ExtractedArchive archive;
};

/// As `extract_archive`, of an archive that holds one drive. @param choice  as above; not kept.
/// @throws as `extract_archive` and `open_drive_folder`.
ExtractedDrive extract_drive(const IncomingArchive& archive, const std::filesystem::path& target,
                             DiskCalls& calls = DiskCalls::real(), const std::string& choice = {});

}  // namespace stillmap::server

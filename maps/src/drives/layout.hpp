#pragma once

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/pose_file.hpp>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "drives/points_frame.hpp"

/// What the openers of the layouts share.
namespace stillmap::maps {

/// Which poses a drive gets.
struct PosesChoice {
  /// Instead of the layout's own.
  std::optional<std::filesystem::path> file;
  /// Added to the stamps of poses that have their own [ns].
  std::int64_t offset_ns = 0;
  /// Of the points, if it was chosen.
  std::optional<PointsFrame> points{};
};

/// Time between scans when no file tells it [ns]: 0.1 s, the turn of most sensors.
inline constexpr std::int64_t kAssumedPeriodNs = 100'000'000;
/// Stamps from here on count from the epoch: 1e8 s, March 1973.
inline constexpr std::int64_t kFirstEpochStampNs = 100'000'000'000'000'000;

/// Files of a folder with this extension (with its dot), sorted by name with digits compared as
/// numbers; empty when there is no such folder. @throws StorageError if it cannot be listed.
[[nodiscard]] std::vector<std::filesystem::path> list_files(const std::filesystem::path& folder,
                                                            std::string_view extension);

/// "000012" -> 12 of "000012.bin"; nothing when the name is not all digits.
[[nodiscard]] std::optional<std::size_t> number_of(const std::filesystem::path& file);

/// Which line of a file with one line a scan belongs to each scan: the scan's place when there are
/// as many lines as scans, else the number in the scan's name (lines from 0), as in a drive of
/// which only some scans were kept.
/// @param lines_file  for messages. @param what  "poses", "times", ...
/// @throws InputError when there are fewer lines than scans, or more and the names do not say
/// which.
[[nodiscard]] std::vector<std::size_t> lines_of_scans(
    const std::vector<std::filesystem::path>& scan_files, std::size_t lines,
    const std::filesystem::path& lines_file, std::string_view what);

/// One stamp in seconds a line. @throws InputError naming file, line and value.
[[nodiscard]] std::vector<std::int64_t> read_times(const std::filesystem::path& file);

/// Stamps of the scans from a file of seconds; the clock is relative when they lie before 1e8 s
/// (March 1973).
void set_times(Drive::Contents& contents, const std::filesystem::path& times_file);

/// 0, 0.1 s, 0.2 s ... on a relative clock, said in the notes.
void assume_times(Drive::Contents& contents);

/// Gives the scans the poses of the trajectory at their stamps, up to 0.2 s beyond its ends. Scans
/// farther out are left out and noted (recorders of scans and poses start and end apart), and so
/// are those in gaps whose place is unknown (pose_gaps.hpp). The trajectory becomes the contents'
/// path.
/// @param offset_ns  added to the stamps of the poses.
/// @throws InputError when no scan has a pose.
/// @return whether scans were left out before the first that has a pose.
bool set_poses_at_stamps(Drive::Contents& contents, const Trajectory& trajectory,
                         const std::filesystem::path& source, std::int64_t offset_ns);

/// Gives the scans `T_map_lidar` from a file of poses (`read_pose_file`) instead of the layout's
/// own: by stamps, by the numbers of scans (between two of them interpolated as by stamps), or in
/// turn. As many numbers as scans, of which none is a scan's or all are shifted by one constant,
/// count in turn, which is noted.
/// @param offset_ns  added to the stamps of the poses.
void set_poses(Drive::Contents& contents, const std::filesystem::path& poses_file,
               std::int64_t offset_ns);
/// The same of a file that was read. @param poses_file  for messages and notes.
void set_poses(Drive::Contents& contents, const PoseFile& poses,
               const std::filesystem::path& poses_file, std::int64_t offset_ns);

/// A stamp with so much added. @throws InputError for `file` where that takes more than 64 bits.
[[nodiscard]] std::int64_t shifted_stamp(std::int64_t stamp_ns, std::int64_t offset_ns,
                                         const std::filesystem::path& file);

/// Shifts poses that have the scans' stamps, one each, in time, as if they had come with stamps of
/// their own. Stamps increase. @throws as `set_poses_at_stamps`.
void shift_poses_of_scans(Drive::Contents& contents, std::int64_t offset_ns);

/// Looks how coarsely positions were written. @param poses  as they stand in the file.
void set_position_step(Drive::Contents& contents, std::span<const Eigen::Isometry3d> poses);
void set_position_step(Drive::Contents& contents, const Trajectory& trajectory);

/// SemanticKITTI labels of the scans, `labels/NAME.label` each; scans without one are noted.
void set_labels(Drive::Contents& contents);

/// Keeps some of the scans with all that belongs to them. @param kept  ascending.
void keep_scans(Drive::Contents& contents, const std::vector<std::size_t>& kept);

/// What the drive knows of a scan's file beyond the file.
[[nodiscard]] ScanFileHints file_hints(const Drive::Contents& contents, std::size_t scan);

/// Reads the files of a drive as entries, so that their reading can be changed. Nothing to do where
/// they are.
void set_entries_of_files(Drive::Contents& contents);

/// Whether a layout is a recording of all that a sensor sent, in a file with other messages.
[[nodiscard]] bool is_recording(DriveLayout layout);

/// "1700000000.100 s".
[[nodiscard]] std::string seconds_text(std::int64_t stamp_ns);

/// Keeps the scans of one clock. Some stamps count from the epoch and others do not, or those of a
/// recording lie more than 30 days apart, where a clock was set or had no time yet. The part with
/// the most scans stays (of equal ones the latest), and a note says what was left out. Sets
/// `relative_clock` by what stays.
/// @throws InputError where all stamps are the same.
void keep_one_clock(Drive::Contents& contents);

/// Leaves out the scans of other clocks, and the fewest scans without which stamps rise from each
/// to the next, and says so. Call it last.
/// @throws InputError if that is more than a tenth of the scans: the stamps then mean something
/// else.
void leave_out_unordered(Drive::Contents& contents);

}  // namespace stillmap::maps

#include "drives/layout.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/pose_file.hpp>
#include <stillmap/maps/scan_file.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <memory>
#include <system_error>
#include <utility>

#include <stillmap/maps/text.hpp>
#include "drives/pose_gaps.hpp"
#include "drives/value_step.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

constexpr double kMaxExtrapolationS = 0.2;

bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// Cuts a run of digits off the front, without its leading zeros.
std::string_view take_digits(std::string_view& text) {
  std::size_t end = 0;
  while (end < text.size() && is_digit(text[end])) ++end;
  std::string_view digits = text.substr(0, end);
  text.remove_prefix(end);
  digits.remove_prefix(std::min(digits.find_first_not_of('0'), digits.size()));
  return digits;
}

/// "scan2" before "scan10".
bool naturally_before(std::string_view a, std::string_view b) {
  const std::string_view whole_a = a;
  const std::string_view whole_b = b;
  while (!a.empty() && !b.empty()) {
    if (is_digit(a[0]) && is_digit(b[0])) {
      const std::string_view number_a = take_digits(a);
      const std::string_view number_b = take_digits(b);
      if (number_a.size() != number_b.size()) return number_a.size() < number_b.size();
      if (number_a != number_b) return number_a < number_b;
    } else if (a[0] != b[0]) {
      return a[0] < b[0];
    } else {
      a.remove_prefix(1);
      b.remove_prefix(1);
    }
  }
  if (a.empty() != b.empty()) return a.empty();
  return whole_a < whole_b;  // "01" and "1"
}

Trajectory path_of_scans(const Drive::Contents& contents) {
  std::vector<StampedPose> path;
  for (std::size_t i = 0; i < contents.stamps_ns.size(); ++i)
    path.push_back({contents.stamps_ns[i], contents.T_map_lidar[i]});
  return Trajectory(std::move(path));
}

Trajectory shifted(const Trajectory& trajectory, std::int64_t offset_ns, const fs::path& file) {
  if (offset_ns == 0) return trajectory;
  std::vector<StampedPose> poses = trajectory.poses();
  for (StampedPose& pose : poses) pose.stamp_ns = shifted_stamp(pose.stamp_ns, offset_ns, file);
  return Trajectory(std::move(poses));
}

/// What to do about stamps that are wrong, beyond correcting them.
std::string remedy_of_stamps(const Drive::Contents& contents) {
  // In rawlogs and captures there is one time alone.
  const bool is_bag = is_recording(contents.layout) && contents.layout != DriveLayout::kRawlog &&
                      contents.layout != DriveLayout::kPcap;
  return is_bag ? fmt::format(
                      "add stamps=recorded behind the drive's path, as in "
                      "'{}?stamps=recorded', for the recorder's times",
                      contents.root.string())
                : "correct their times";
}

}  // namespace

std::string seconds_text(std::int64_t stamp_ns) {
  return fmt::format("{:.3f} s", 1e-9 * static_cast<double>(stamp_ns));
}

std::vector<fs::path> list_files(const fs::path& folder, std::string_view extension) {
  std::vector<fs::path> files;
  std::error_code error;
  if (!fs::is_directory(folder, error)) return files;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    if (entry->path().extension() == extension && !entry->is_directory()) {
      files.push_back(entry->path());
    }
  }
  if (error) throw StorageError(folder.string(), error.message());
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return naturally_before(a.filename().native(), b.filename().native());
  });
  return files;
}

std::optional<std::size_t> number_of(const fs::path& file) {
  return parse_count(file.stem().native());
}

std::vector<std::size_t> lines_of_scans(const std::vector<fs::path>& scan_files, std::size_t lines,
                                        const fs::path& lines_file, std::string_view what) {
  if (lines < scan_files.size()) {
    throw InputError(lines_file.string(), fmt::format("{} {}", lines, what),
                     fmt::format("{}, one for each scan: give the whole file, or take it away",
                                 scan_files.size()));
  }
  std::vector<std::size_t> result;
  for (std::size_t i = 0; i < scan_files.size(); ++i) {
    if (lines == scan_files.size()) {
      result.push_back(i);
      continue;
    }
    const std::optional<std::size_t> number = number_of(scan_files[i]);
    if (!number || *number >= lines) {
      throw InputError(lines_file.string(), fmt::format("{} {}", lines, what),
                       fmt::format("{}, one for each scan: give the file of these scans, or name "
                                   "each scan file by its line (from 0), as {} is not",
                                   scan_files.size(), scan_files[i].filename().string()));
    }
    result.push_back(*number);
  }
  return result;
}

std::vector<std::int64_t> read_times(const fs::path& file) {
  const std::string text = read_text(file);
  std::vector<std::int64_t> stamps;
  for (const NumberLine& line : number_lines(text)) {
    const std::optional<std::int64_t> stamp =
        line.fields.size() == 1 ? parse_stamp_ns(line.fields[0]) : std::nullopt;
    if (!stamp) {
      throw InputError(place(file, line.line), "'" + std::string(line.fields[0]) + "'",
                       "one time in seconds on each line: correct the line");
    }
    stamps.push_back(*stamp);
  }
  return stamps;
}

void set_times(Drive::Contents& contents, const fs::path& times_file) {
  const std::vector<std::int64_t> times = read_times(times_file);
  contents.stamps_ns.clear();
  for (const std::size_t line :
       lines_of_scans(contents.scan_files, times.size(), times_file, "times")) {
    contents.stamps_ns.push_back(times[line]);
  }
  contents.relative_clock =
      contents.stamps_ns.empty() || contents.stamps_ns.front() < kFirstEpochStampNs;
}

void assume_times(Drive::Contents& contents) {
  contents.stamps_ns.clear();
  for (std::size_t i = 0; i < contents.scan_files.size(); ++i) {
    contents.stamps_ns.push_back(static_cast<std::int64_t>(i) * kAssumedPeriodNs);
  }
  contents.relative_clock = true;
  contents.notes.emplace_back("no file tells the scans' times: taken as 0.1 s apart");
}

bool set_poses_at_stamps(Drive::Contents& contents, const Trajectory& own, const fs::path& source,
                         std::int64_t offset_ns) {
  const Trajectory trajectory = shifted(own, offset_ns, source);
  const std::vector<StampedPose>& path = trajectory.poses();
  if (path.empty()) throw InputError(source.string(), "no poses", "one or more");
  const std::vector<std::int64_t>& stamps = contents.stamps_ns;
  const PoseGaps gaps(trajectory);
  ScansInGaps in_gaps;
  std::vector<std::size_t> kept;
  std::vector<Eigen::Isometry3d> poses;
  for (std::size_t i = 0; i < stamps.size(); ++i) {
    const std::optional<Eigen::Isometry3d> pose = trajectory.at(stamps[i], kMaxExtrapolationS);
    if (!pose || !in_gaps.add(gaps.of(stamps[i]))) continue;
    kept.push_back(i);
    poses.push_back(*pose);
  }
  if (kept.empty()) {
    throw InputError(
        source.string(),
        fmt::format("poses from {} to {}, no pose within {} s of any scan",
                    seconds_text(path.front().stamp_ns), seconds_text(path.back().stamp_ns),
                    kMaxExtrapolationS),
        fmt::format("poses of scans from {} to {}: give the poses of this drive; if the "
                    "clocks differ, build with --pose-time-offset SECONDS",
                    seconds_text(stamps.front()), seconds_text(stamps.back())));
  }
  const std::string name = source.filename().string();
  if (const std::size_t without = stamps.size() - kept.size() - in_gaps.left_out; without > 0)
    contents.notes.push_back(fmt::format(
        "{} scans left out, which have no pose in {}; the others count from 0", without, name));
  keep_scans(contents, kept);
  contents.T_map_lidar = std::move(poses);
  in_gaps.note(contents, name);
  contents.path = std::make_shared<const Trajectory>(trajectory);
  contents.poses_have_stamps = true;
  return kept.front() > 0;
}

namespace {

/// Numbers of the scans in their names or their bag; nothing where one has none.
std::optional<std::vector<std::size_t>> numbers_of_scans(const Drive::Contents& contents) {
  if (!contents.entries.numbers.empty()) return contents.entries.numbers;
  std::vector<std::size_t> numbers;
  for (const fs::path& file : contents.scan_files) {
    const auto number = number_of(file);
    if (!number) return std::nullopt;
    numbers.push_back(*number);
  }
  return numbers;
}

/// Whether as many numbers differ from those of the scans by one constant.
bool are_shifted(const std::vector<std::size_t>& of_scans, const std::vector<std::size_t>& sorted) {
  if (of_scans.size() != sorted.size()) return false;
  for (std::size_t i = 0; i < sorted.size(); ++i)
    if (sorted[i] - of_scans[i] != sorted[0] - of_scans[0]) return false;
  return true;
}

/// The pose of each scan, as an index into `poses`, by the numbers; in order where these are none
/// of the scans', or all are shifted.
std::vector<std::optional<std::size_t>> poses_by_number(Drive::Contents& contents,
                                                        const PoseFile& poses,
                                                        const std::string& name) {
  std::map<std::size_t, std::size_t> pose_of_number;
  for (std::size_t i = 0; i < poses.numbers.size(); ++i) pose_of_number[poses.numbers[i]] = i;
  const std::size_t scans = contents.scan_files.size();
  const auto numbers = numbers_of_scans(contents);
  std::vector<std::optional<std::size_t>> found(scans);
  std::size_t matches = 0;
  for (std::size_t i = 0; numbers && i < scans; ++i) {
    const auto pose = pose_of_number.find((*numbers)[i]);
    if (pose == pose_of_number.end()) continue;
    found[i] = pose->second;
    ++matches;
  }
  if (matches == scans || pose_of_number.size() != scans) return found;
  std::vector<std::size_t> sorted;
  for (const auto& [number, pose] : pose_of_number) sorted.push_back(number);
  if (matches > 0 && !are_shifted(*numbers, sorted)) return found;
  contents.notes.push_back(
      fmt::format("the numbers in {}, {} to {}, are not those of the scans: as many poses as scans "
                  "are assigned in order",
                  name, sorted.front(), sorted.back()));
  for (std::size_t i = 0; i < scans; ++i) found[i] = pose_of_number.at(sorted[i]);
  return found;
}

void set_numbered_poses(Drive::Contents& contents, const PoseFile& poses,
                        const fs::path& poses_file, std::int64_t offset_ns) {
  const std::string name = poses_file.filename().string();
  const auto found = poses_by_number(contents, poses, name);
  std::vector<StampedPose> path;
  for (std::size_t i = 0; i < found.size(); ++i)
    if (found[i]) path.push_back({contents.stamps_ns[i], poses.poses[*found[i]]});
  if (path.empty()) {
    const auto [least, most] = std::minmax_element(poses.numbers.begin(), poses.numbers.end());
    throw InputError(
        poses_file.string(), fmt::format("poses of scans {} to {}", *least, *most),
        fmt::format("numbers of these scans, as in the name {}: give the poses of this drive",
                    contents.scan_files.front().filename().string()));
  }
  std::stable_sort(path.begin(), path.end(), [](const StampedPose& a, const StampedPose& b) {
    return a.stamp_ns < b.stamp_ns;
  });
  const auto same = std::unique(
      path.begin(), path.end(),
      [](const StampedPose& a, const StampedPose& b) { return a.stamp_ns == b.stamp_ns; });
  if (const auto count = path.end() - same; count > 0)
    contents.notes.push_back(fmt::format(
        "{} poses in {} are left out, whose scans have the stamp of another scan", count, name));
  path.erase(same, path.end());
  contents.counts_from_first_pose =
      set_poses_at_stamps(contents, Trajectory(std::move(path)), poses_file, offset_ns);
}

}  // namespace

void set_poses(Drive::Contents& contents, const fs::path& poses_file, std::int64_t offset_ns) {
  set_poses(contents, read_pose_file(poses_file), poses_file, offset_ns);
}

void set_poses(Drive::Contents& contents, const PoseFile& poses, const fs::path& poses_file,
               std::int64_t offset_ns) {
  set_position_step(contents, poses.all());
  if (poses.has_stamps()) {
    contents.counts_from_first_pose =
        set_poses_at_stamps(contents, poses.stamped, poses_file, offset_ns);
    return;
  }
  if (!poses.numbers.empty()) return set_numbered_poses(contents, poses, poses_file, offset_ns);
  if (poses.format == "csv") {
    // Its rows need not be those of scans, as KITTI's lines are.
    if (poses.poses.size() != contents.scan_files.size())
      throw InputError(
          poses_file.string(),
          fmt::format("{} poses without stamp or number of a scan", poses.poses.size()),
          fmt::format("{}, one for each scan, or a column that says which: name it timestamp or "
                      "frame",
                      contents.scan_files.size()));
    contents.notes.push_back(
        fmt::format("poses in {} have neither stamp nor number: they are assigned in order",
                    poses_file.filename().string()));
  }
  contents.T_map_lidar.clear();
  for (const std::size_t line :
       lines_of_scans(contents.scan_files, poses.poses.size(), poses_file, "poses")) {
    contents.T_map_lidar.push_back(poses.poses[line]);
  }
}

std::int64_t shifted_stamp(std::int64_t stamp_ns, std::int64_t offset_ns, const fs::path& file) {
  std::int64_t shifted_ns = 0;
  if (__builtin_add_overflow(stamp_ns, offset_ns, &shifted_ns))
    throw InputError(
        file.string(),
        fmt::format("the stamp {} ns, which leaves 64 bits with --pose-time-offset", stamp_ns),
        "a smaller --pose-time-offset");
  return shifted_ns;
}

void shift_poses_of_scans(Drive::Contents& contents, std::int64_t offset_ns) {
  const bool before =
      set_poses_at_stamps(contents, path_of_scans(contents), contents.root, offset_ns);
  contents.counts_from_first_pose = contents.counts_from_first_pose || before;
}

void set_position_step(Drive::Contents& contents, std::span<const Eigen::Isometry3d> poses) {
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    values.reserve(poses.size());
    for (const Eigen::Isometry3d& T : poses) values.push_back(T.translation()[axis]);
    contents.position_step_m[axis] = step_of(values);
  }
}

void set_position_step(Drive::Contents& contents, const Trajectory& trajectory) {
  std::vector<Eigen::Isometry3d> poses;
  for (const StampedPose& pose : trajectory.poses()) poses.push_back(pose.T_map_lidar);
  set_position_step(contents, poses);
}

void set_labels(Drive::Contents& contents) {
  const std::filesystem::path labels = contents.root / "labels";
  if (!std::filesystem::is_directory(labels)) return;
  std::size_t missing = 0;
  for (const std::filesystem::path& scan : contents.scan_files) {
    std::filesystem::path file = labels / (scan.stem().string() + ".label");
    if (!std::filesystem::exists(file)) {
      ++missing;
      file.clear();
    }
    contents.label_files.push_back(std::move(file));
  }
  if (missing > 0) contents.notes.push_back(fmt::format("{} scans without labels", missing));
}

ScanFileHints file_hints(const Drive::Contents& contents, std::size_t scan) {
  ScanFileHints hints;
  hints.bin_columns = contents.bin_columns;
  if (!contents.relative_clock) hints.stamp_ns = contents.stamps_ns[scan];
  return hints;
}

void set_entries_of_files(Drive::Contents& contents) {
  Drive::Contents::Entries& entries = contents.entries;
  if (!entries.numbers.empty()) return;
  const auto& files = contents.scan_files;
  for (std::size_t i = 0; i < files.size(); ++i) entries.numbers.push_back(i);
  std::vector<ScanFileHints> hints;
  for (std::size_t i = 0; i < files.size(); ++i) hints.push_back(file_hints(contents, i));
  entries.read = [files, hints = std::move(hints)](std::size_t i) {
    return read_scan_file(files.at(i), hints.at(i));
  };
  entries.sha256 = [files](std::size_t i) { return sha256_of_file(files.at(i)); };
}

bool is_recording(DriveLayout layout) {
  return layout == DriveLayout::kMcap || layout == DriveLayout::kRosbag2 ||
         layout == DriveLayout::kRosbag1 || layout == DriveLayout::kPcap ||
         layout == DriveLayout::kRawlog;
}

void keep_scans(Drive::Contents& contents, const std::vector<std::size_t>& kept) {
  const auto keep = [&](auto& values) {
    if (values.empty()) return;
    for (std::size_t i = 0; i < kept.size(); ++i) values[i] = values[kept[i]];
    values.resize(kept.size());
  };
  keep(contents.scan_files);
  keep(contents.entries.numbers);
  keep(contents.stamps_ns);
  keep(contents.T_map_lidar);
  keep(contents.spin_start_end_s);
  keep(contents.label_files);
}

namespace {

/// Two stamps that follow each other in order. A recording takes no month; folders may hold scans
/// of several days.
bool are_of_one_clock(std::int64_t before_ns, std::int64_t after_ns, bool is_recorded) {
  constexpr double kMostApartNs = 30.0 * 24.0 * 3600.0 * 1e9;
  // As doubles: the difference of two stamps may leave 64 bits.
  const double apart_ns = static_cast<double>(after_ns) - static_cast<double>(before_ns);
  if (apart_ns < kMostApartNs) return true;
  return !is_recorded && (before_ns >= kFirstEpochStampNs || after_ns < kFirstEpochStampNs);
}

}  // namespace

void keep_one_clock(Drive::Contents& contents) {
  const bool is_recorded = is_recording(contents.layout);
  std::vector<std::int64_t> sorted = contents.stamps_ns;
  if (sorted.empty()) return;
  std::sort(sorted.begin(), sorted.end());
  if (sorted.size() > 1 && sorted.front() == sorted.back())
    throw InputError(
        contents.root.string(),
        fmt::format("the stamp {} for all {} scans", seconds_text(sorted.front()), sorted.size()),
        "a stamp of its own for each scan: " + remedy_of_stamps(contents));
  std::size_t begin = 0, longest = 0;
  std::int64_t from_ns = 0, to_ns = 0;
  for (std::size_t i = 1; i <= sorted.size(); ++i) {
    if (i < sorted.size() && are_of_one_clock(sorted[i - 1], sorted[i], is_recorded)) continue;
    if (i - begin >= longest) {
      longest = i - begin;
      from_ns = sorted[begin];
      to_ns = sorted[i - 1];
    }
    begin = i;
  }
  contents.relative_clock = from_ns < kFirstEpochStampNs;
  if (longest == sorted.size()) return;
  std::vector<std::size_t> kept;
  std::string first_other;
  for (std::size_t i = 0; i < contents.stamps_ns.size(); ++i) {
    const std::int64_t stamp_ns = contents.stamps_ns[i];
    if (stamp_ns >= from_ns && stamp_ns <= to_ns)
      kept.push_back(i);
    else if (first_other.empty())
      first_other = fmt::format("{} at {}", contents.scan_name(i), seconds_text(stamp_ns));
  }
  const std::size_t others = contents.stamps_ns.size() - kept.size();
  keep_scans(contents, kept);
  contents.notes.push_back(
      fmt::format("{} scans left out, whose stamps are of another clock than the {} from {} to {}: "
                  "the first is "
                  "{}; to keep them, {}",
                  others, kept.size(), seconds_text(from_ns), seconds_text(to_ns), first_other,
                  remedy_of_stamps(contents)));
}

/// The most values, by their indices, that rise from each to the next (patience sorting): one that
/// is far off costs itself and not those after it.
std::vector<std::size_t> longest_rise(const std::vector<std::int64_t>& values) {
  // Of the rises of each length the one that ends lowest, by its end; what comes before each.
  std::vector<std::size_t> ends, before(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto at = std::partition_point(ends.begin(), ends.end(),
                                         [&](std::size_t end) { return values[end] < values[i]; });
    before[i] = at == ends.begin() ? i : *std::prev(at);
    if (at == ends.end())
      ends.push_back(i);
    else if (values[i] < values[*at])
      *at = i;
  }
  std::vector<std::size_t> rise(ends.size());
  for (std::size_t length = ends.size(), i = ends.empty() ? 0 : ends.back(); length > 0;
       i = before[i])
    rise[--length] = i;
  return rise;
}

void leave_out_unordered(Drive::Contents& contents) {
  keep_one_clock(contents);
  const std::vector<std::size_t> kept = longest_rise(contents.stamps_ns);
  std::string left_out;
  for (std::size_t i = 0, next = 0; i < contents.stamps_ns.size() && left_out.size() < 200; ++i) {
    if (next < kept.size() && kept[next] == i)
      ++next;
    else
      left_out += ' ' + contents.scan_name(i);
  }
  const std::size_t count = contents.stamps_ns.size() - kept.size();
  if (count == 0) return;
  if (count * 10 > contents.stamps_ns.size()) {
    throw InputError(
        contents.root.string(),
        fmt::format("stamps out of order for {} of {} scans", count, contents.stamps_ns.size()),
        "ascending stamps: sort the scans by time, or " + remedy_of_stamps(contents));
  }
  keep_scans(contents, kept);
  contents.notes.push_back(
      fmt::format("{} scans left out, whose stamps are out of order:{}", count, left_out));
}

}  // namespace stillmap::maps

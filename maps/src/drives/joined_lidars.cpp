#include "drives/joined_lidars.hpp"

#include <stillmap/maps/drive_address.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/lidar_set.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/median.hpp>
#include <stillmap/maps/recording_choice.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "drives/address.hpp"

namespace stillmap::maps {
namespace {

/// Of one other lidar, for each scan of the reference: its sweeps [first, first + count).
struct JoinedSweeps {
  std::vector<std::uint32_t> first;
  std::vector<std::uint32_t> count;
};

struct JoinedDrives {
  Drive reference;
  std::vector<BesideLidar> others;
  /// One for each of the others.
  std::vector<JoinedSweeps> sweeps;
  /// Where the lidars stand, the reference first.
  std::vector<Eigen::Vector3f> origins;
  /// How the others are placed, for digests.
  std::string mounts;
};

/// What one sweep adds to a scan. Attributes that only some of the clouds have are filled with 0.
class JoinedScan {
 public:
  JoinedScan(Scan reference, const std::vector<Eigen::Vector3f>& origins) {
    scan_.cloud = std::move(reference.cloud);
    scan_.dropped = reference.dropped;
    scan_.points_in_file = reference.points_in_file;
    scan_.times_note = std::move(reference.times_note);
    scan_.cloud.lidars.assign(scan_.cloud.size(), 0);
    scan_.cloud.lidar_origins = origins;
  }

  /// @param offset_s  of its stamp from the reference's.
  void add(const Scan& sweep, std::uint8_t lidar, const Eigen::Isometry3d& T_reference_lidar,
           double offset_s) {
    PointCloud& cloud = scan_.cloud;
    const std::size_t before = cloud.size(), size = before + sweep.cloud.size();
    join(cloud.intensities, sweep.cloud.intensities, before, size);
    if (offset_s != 0.0 || !sweep.cloud.time_offsets_s.empty()) cloud.time_offsets_s.resize(before);
    join(cloud.time_offsets_s, sweep.cloud.time_offsets_s, before, size);
    for (std::size_t i = before; i < cloud.time_offsets_s.size(); ++i)
      cloud.time_offsets_s[i] += static_cast<float>(offset_s);
    if (!cloud.file_indices.empty() || !sweep.cloud.file_indices.empty() ||
        before != scan_.points_in_file) {
      for (std::size_t i = cloud.file_indices.size(); i < before; ++i)
        cloud.file_indices.push_back(static_cast<std::uint32_t>(i));
      for (std::size_t i = 0; i < sweep.cloud.size(); ++i)
        cloud.file_indices.push_back(
            static_cast<std::uint32_t>(scan_.points_in_file + sweep.cloud.file_index(i)));
    }
    for (const Eigen::Vector3f& p : sweep.cloud.positions)
      cloud.positions.push_back((T_reference_lidar * p.cast<double>()).cast<float>());
    cloud.lidars.resize(size, lidar);
    scan_.dropped += sweep.dropped;
    scan_.points_in_file += sweep.points_in_file;
    if (scan_.times_note.empty()) scan_.times_note = sweep.times_note;
  }

  [[nodiscard]] DecodedScan take() { return std::move(scan_); }

 private:
  static void join(std::vector<float>& values, const std::vector<float>& more, std::size_t before,
                   std::size_t size) {
    if (values.empty() && more.empty()) return;
    values.resize(before);
    values.insert(values.end(), more.begin(), more.end());
    values.resize(size);
  }

  DecodedScan scan_;
};

std::int64_t sweep_stamp_ns(const BesideLidar& lidar, std::size_t sweep) {
  return shifted_stamp(lidar.drive.stamp_ns(sweep), lidar.offset_ns, lidar.drive.contents().root);
}

DecodedScan read_joined(const JoinedDrives& drives, std::size_t number) {
  JoinedScan scan(drives.reference.read(number), drives.origins);
  for (std::size_t k = 0; k < drives.others.size(); ++k) {
    const BesideLidar& lidar = drives.others[k];
    const JoinedSweeps& sweeps = drives.sweeps[k];
    for (std::size_t i = 0; i < sweeps.count[number]; ++i) {
      const std::size_t sweep = sweeps.first[number] + i;
      const std::int64_t apart_ns =
          sweep_stamp_ns(lidar, sweep) - drives.reference.stamp_ns(number);
      scan.add(lidar.drive.read(sweep), static_cast<std::uint8_t>(k + 1), lidar.T_reference_lidar,
               1e-9 * static_cast<double>(apart_ns));
    }
  }
  return scan.take();
}

std::string sha256_of_joined(const JoinedDrives& drives, std::size_t number) {
  std::string all = drives.reference.sha256(number) + drives.mounts;
  for (std::size_t k = 0; k < drives.others.size(); ++k)
    for (std::size_t i = 0; i < drives.sweeps[k].count[number]; ++i) {
      const std::size_t sweep = drives.sweeps[k].first[number] + i;
      all += fmt::format(" {} {}", k, drives.others[k].drive.sha256(sweep));
    }
  return sha256_of(all);
}

/// Usual time between scans.
std::int64_t usual_period_ns(const Drive& drive) {
  std::vector<std::int64_t> periods;
  for (std::size_t i = 1; i < drive.size(); ++i)
    periods.push_back(drive.stamp_ns(i) - drive.stamp_ns(i - 1));
  return periods.empty() ? kAssumedPeriodNs : median(std::move(periods));
}

/// Stamps rise in both drives, so that the sweeps of a scan follow each other.
JoinedSweeps joined_sweeps(const Drive& reference, const std::string& name,
                           const BesideLidar& lidar, std::vector<std::string>& notes) {
  const std::vector<std::int64_t>& stamps = reference.contents().stamps_ns;
  const std::int64_t most_ns = usual_period_ns(reference) / 2;
  JoinedSweeps joined;
  joined.first.resize(stamps.size());
  joined.count.resize(stamps.size());
  std::size_t taken = 0;
  for (std::size_t sweep = 0; sweep < lidar.drive.size(); ++sweep) {
    const std::int64_t stamp_ns = sweep_stamp_ns(lidar, sweep);
    const auto after = std::ranges::lower_bound(stamps, stamp_ns);
    std::size_t scan = static_cast<std::size_t>(after - stamps.begin());
    if (scan == stamps.size() ||
        (scan > 0 && stamp_ns - stamps[scan - 1] <= stamps[scan] - stamp_ns))
      --scan;
    if (std::abs(stamp_ns - stamps[scan]) > most_ns) continue;
    if (joined.count[scan]++ == 0) joined.first[scan] = static_cast<std::uint32_t>(sweep);
    ++taken;
  }
  const double most_s = 1e-9 * static_cast<double>(most_ns);
  if (taken == 0)
    throw InputError(
        lidar.drive.contents().root.string(),
        fmt::format("no sweep of {} within {:.3g} s of a scan of {}", lidar.name, most_s, name),
        "sweeps of the same time: set time_offset_s in lidars.json if the clocks differ");
  if (taken < lidar.drive.size())
    notes.push_back(fmt::format("{} of {} sweeps of {} left out: no scan of {} within {:.3g} s",
                                lidar.drive.size() - taken, lidar.drive.size(), lidar.name, name,
                                most_s));
  if (const auto alone = std::ranges::count(joined.count, 0U); alone > 0)
    notes.push_back(fmt::format("{} of {} scans of {} have no sweep of {} within {:.3g} s", alone,
                                stamps.size(), name, lidar.name, most_s));
  return joined;
}

/// Nobody asks for the choice of a drive in a set, so it has to be made in lidars.json.
Drive open_lidar(const std::filesystem::path& set, const std::string& drive,
                 const PosesChoice& poses) {
  try {
    return Drive::open(set / drive, poses.file, poses.offset_ns);
  } catch (const ChoiceError& error) {
    throw InputError((set / kLidarSetFile).string(),
                     fmt::format("'{}', which leaves a choice ({})", drive, error.what()),
                     fmt::format("the choice in this file: add it to the drive's name, as in "
                                 "\"{}?{}={}\"",
                                 drive.substr(0, drive.find('?')), error.topics().front().word,
                                 error.topics().front().name));
  }
}

}  // namespace

Drive::Contents joined_lidars(const Drive& reference, const std::string& name,
                              std::vector<BesideLidar> others) {
  Drive::Contents contents = reference.contents();
  auto drives = std::make_shared<JoinedDrives>(
      JoinedDrives{reference, std::move(others), {}, {Eigen::Vector3f::Zero()}, {}});
  contents.lidars = {name};
  for (const BesideLidar& lidar : drives->others) {
    drives->sweeps.push_back(joined_sweeps(reference, name, lidar, contents.notes));
    drives->origins.push_back(lidar.T_reference_lidar.translation().cast<float>());
    drives->mounts += fmt::format(
        " {} {}", fmt::join(lidar.T_reference_lidar.matrix().reshaped(), " "), lidar.offset_ns);
    contents.lidars.push_back(lidar.name);
    for (const std::string& note : lidar.drive.contents().notes)
      contents.notes.push_back(lidar.name + ": " + note);
  }
  contents.notes.push_back(
      fmt::format("scans of {} lidars as one, in the frame of {}", contents.lidars.size(), name));
  if (!contents.label_files.empty())
    contents.notes.emplace_back("labels left out: they are of one lidar alone");
  contents.label_files.clear();
  contents.spin_start_end_s.clear();
  Drive::Contents::Entries& entries = contents.entries;
  // Scans with other mounts are called otherwise: what was found in them is not taken over.
  entries.topic =
      fmt::format("{} {}", fmt::join(contents.lidars, ","), sha256_of(drives->mounts).substr(0, 8));
  entries.numbers.resize(reference.size());
  for (std::size_t i = 0; i < reference.size(); ++i) entries.numbers[i] = i;
  entries.read = [drives](std::size_t number) { return read_joined(*drives, number); };
  entries.sha256 = [drives](std::size_t number) { return sha256_of_joined(*drives, number); };
  return contents;
}

bool is_lidar_set(const std::filesystem::path& root) {
  return std::filesystem::is_regular_file(root / kLidarSetFile);
}

Drive::Contents open_lidar_set(const std::filesystem::path& root, const PosesChoice& poses) {
  const std::filesystem::path file = root / kLidarSetFile;
  const std::vector<MountedLidar> lidars = read_lidar_set(file);
  if (poses.points)
    throw InputError(root.string(), "points= behind a drive of several lidars",
                     "its folder alone: write points= behind each drive's name in lidars.json");
  for (const MountedLidar& lidar : lidars) {
    if (is_lidar_set(address_of(root / lidar.drive).place))
      throw InputError(file.string(), "'" + lidar.drive + "', which is a drive of several lidars",
                       "drives of one lidar each: name these");
  }
  const auto named = [&](const std::string& drive) {
    return split_address(root / drive).place.filename().string();
  };
  const bool same_place = std::ranges::all_of(lidars, [&](const MountedLidar& lidar) {
    return named(lidar.drive) == named(lidars.front().drive);
  });
  const auto name_of_lidar = [&](const MountedLidar& lidar) {
    return same_place ? lidar.drive : named(lidar.drive);
  };
  const Drive reference = open_lidar(root, lidars.front().drive, poses);
  std::vector<BesideLidar> others;
  for (std::size_t i = 1; i < lidars.size(); ++i)
    others.push_back({open_lidar(root, lidars[i].drive, {}), name_of_lidar(lidars[i]),
                      lidars[i].T_reference_lidar, std::llround(1e9 * lidars[i].time_offset_s)});
  for (const BesideLidar& lidar : others) {
    if (!lidar.drive.contents().lidars.empty() || !reference.contents().lidars.empty())
      throw InputError(file.string(), "'" + lidar.name + "', a drive of several lidars",
                       "drives of one lidar each: name one topic of clouds for each");
  }
  Drive::Contents contents =
      joined_lidars(reference, name_of_lidar(lidars.front()), std::move(others));
  contents.root = root;
  // If they were to be shifted, the reference's have been.
  contents.poses_have_stamps = contents.poses_have_stamps || poses.offset_ns != 0;
  return contents;
}

}  // namespace stillmap::maps

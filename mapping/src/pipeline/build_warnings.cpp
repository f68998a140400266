#include "pipeline/build_warnings.hpp"

#include "pipeline/build.hpp"
#include "pipeline/build_journal.hpp"
#include "pipeline/opened_drives.hpp"

#include <stillmap/maps/pose_disagreement.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <span>
#include <string>
#include <vector>

namespace stillmap::mapping {
namespace {

/// A vehicle takes less of a scan than this; what takes more is the world around it.
constexpr double kMostTooNear = 0.2;

/// Numbers of scans in their drive, the first ones of them.
std::string first_scans(const DriveSet& drives, std::span<const std::size_t> scans) {
  constexpr std::size_t kNamed = 5;
  std::string text = scans.size() == 1 ? "scan " : "scans ";
  for (std::size_t i = 0; i < std::min(scans.size(), kNamed); ++i)
    text += fmt::format("{}{} ({})", i == 0 ? "" : ", ", drives.place(scans[i]).index,
                        drives.name(scans[i]));
  return scans.size() > kNamed ? text + ", ..." : text;
}

}  // namespace

void warn_of_discarded(const BuildJournal& journal, MapBuildResult& result) {
  if (!journal.discarded().empty() && result.warnings.empty())
    result.warnings.push_back("work of a killed build was thrown away: " + journal.discarded());
}

void warn_of_useless_offset(Build& build) {
  const MapBuildOptions& options = build.task.options;
  const bool is_asked = options.finds_pose_time_offset || options.pose_time_offset_s != 0.0;
  if (!is_asked || uses_given_poses(build.task.odometry, options)) return;
  build.result.warnings.push_back(
      fmt::format("--pose-time-offset has no effect: --odometry {} does not use the given poses; "
                  "leave it out, or give --pose-sigma or --gnss-sigma",
                  build.task.odometry));
}

void warn_of_found_offsets(Build& build) {
  const std::vector<double>& offsets_s = build.result.found_pose_time_offsets_s;
  for (std::size_t i = 0; i < offsets_s.size(); ++i) {
    if (offsets_s[i] == 0.0) continue;
    build.result.warnings.push_back(fmt::format(
        "{}: {:.3f} s were added to the stamps of the poses, as the scans' motion tells "
        "(--pose-time-offset auto)",
        build.task.drives[i].contents().root.string(), offsets_s[i]));
  }
}

void warn_of_given_poses(Build& build) {
  const auto& given = build.result.given_poses;
  if (!given) return;
  if (given->use == GivenPosesUse::kRefine && given->errors.denied > 0)
    build.result.warnings.push_back(
        fmt::format("{} of {} given poses (one in 10 m was compared) disagree with the scans; "
                    "check the drive's trajectory, or build with --odometry default --gnss-sigma "
                    "METRES",
                    given->errors.denied, given->errors.asked));
  if (given->use != GivenPosesUse::kExact || given->neighbours_apart == 0) return;
  const PoseDifferences& neighbours = given->errors.by_way.front();
  build.result.warnings.push_back(fmt::format(
      "{} of {} given poses are more than a voxel ({} m) off from what the scan before shows: "
      "{:.2f} m at most, {:.3f} m in the median; build with --given-poses refine",
      given->neighbours_apart, neighbours.pairs, build.task.options.voxel_size_m, neighbours.max_m,
      neighbours.median_m));
}

void warn_of_pose_faults(Build& build) {
  for (const maps::DriveFinding& fault : build.result.pose_faults)
    build.result.warnings.push_back(fault.what + "; " + fault.remedy);
}

void warn_of_hidden_scans(Build& build) {
  const DriveSet& drives = *build.drives;
  std::vector<std::size_t> hidden, anew;
  for (std::size_t scan = 0; scan < drives.size(); ++scan) {
    if (drives.note(scan) == ScanNote::kHidden) hidden.push_back(scan);
    if (drives.note(scan) == ScanNote::kBeginsAnew) anew.push_back(scan);
  }
  if (!hidden.empty())
    build.result.warnings.push_back(
        fmt::format("{} of {} scans do not show what the scans before and after them show (a "
                    "covered sensor, dust, or a frame that was sent again), and are left out of "
                    "the map; look at {}, and clean or repair the sensor",
                    hidden.size(), drives.size(), first_scans(drives, hidden)));
  if (!anew.empty())
    build.result.warnings.push_back(fmt::format(
        "odometry lost the place and restarted at {}: how the parts before and after lie to each "
        "other is a guess; give poses, or build a map of each part (--select BEGIN:END)",
        first_scans(drives, anew)));
}

void warn_of_bent_places(Build& build) {
  const maps::BentPlaces bent = maps::bent_places(build.disagreements);
  const auto& given = build.result.given_poses;
  const bool is_exact = given && given->use == GivenPosesUse::kExact;
  const bool is_said = is_exact && given->neighbours_apart > 0;
  if (bent.poses == 0 || is_said) return;
  build.result.warnings.push_back(fmt::format(
      "the map is bent or torn around {} of {} scans, most around {}: poses there disagree by "
      "{:.2f} m with the motion that the scans show over 10 m; {}",
      bent.poses, build.disagreements.size(), first_scans(*build.drives, std::array{bent.worst}),
      bent.worst_m,
      is_exact ? "build with --given-poses refine"
               : "look at the map there; if walls are doubled, record this place again"));
}

void warn_of_near_points(Build& build) {
  const MapBuildResult& result = build.result;
  const auto count = [&](const char* name) { return static_cast<double>(result.points.at(name)); };
  const double returned = count("in") - count("dropped_non_finite") - count("dropped_zero_range");
  const double too_near = count("dropped_too_near");
  if (!(too_near > kMostTooNear * returned)) return;
  build.result.warnings.push_back(
      fmt::format("{:.0f} % of the points are left out, because they are nearer than --min-range "
                  "{} m, which is to leave out the vehicle itself; set it to how far the vehicle "
                  "reaches from the sensor, or give DRIVE?sensor=NAME",
                  100.0 * too_near / returned, build.task.options.min_range_m));
}

void warn_of_unmatched_edits(Build& build) {
  for (const std::string& edit : build.objects.edits.unmatched)
    build.result.warnings.push_back("correction without effect: " + edit +
                                    "; check its place and scope in the edits file, or delete it");
}

}  // namespace stillmap::mapping

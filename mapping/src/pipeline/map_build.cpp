#include "drives/drive_set.hpp"
#include "pipeline/build_journal.hpp"
#include "pipeline/build_key.hpp"
#include "pipeline/manifest.hpp"
#include "pipeline/object_pass.hpp"
#include "pipeline/placing_pass.hpp"
#include "pipeline/posed_drives.hpp"
#include "pipeline/posed_drives_bytes.hpp"
#include "pipeline/scan_stages.hpp"
#include "pipeline/survey_pass.hpp"
#include "pipeline/tile_pass.hpp"
#include "registration/map_registration.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <stillmap/mapping/detector.hpp>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/edits.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/geodesy.hpp>
#include <stillmap/maps/map_graph.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/peak_memory.hpp>
#include <stillmap/maps/pose_disagreement.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <fstream>
#include <iterator>
#include <new>
#include <span>
#include <sstream>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

using Clock = std::chrono::steady_clock;

/// A vehicle takes less of a scan than this; what takes more is the world around it.
constexpr double kMostTooNear = 0.2;

/// In the package while it is written: what outlives a kill.
constexpr const char* kJournalFolder = "journal";
constexpr const char* kScratchFolder = "scratch";

/// Where a build works.
struct Folders {
  std::vector<std::filesystem::path> drives;
  std::filesystem::path journal;
  /// In the package while it is written.
  std::filesystem::path scratch;
};

/// Whole metres, so that the same place gets the same origin from slightly different poses.
Eigen::Vector3d origin_of(const DriveSet& drives, const std::optional<BuildFrame>& frame) {
  if (frame) return frame->origin;
  return drives.T_map_scan(0).translation().array().round().matrix() +
         Eigen::Vector3d::Zero();  // turns -0 into 0
}

std::unique_ptr<Cleaner> cleaner_of(const std::string& name, const CleanerFactory& make_cleaner) {
  if (name == "free-space" || name == "none") return nullptr;
  auto cleaner = make_cleaner ? make_cleaner(name) : nullptr;
  if (!cleaner)
    throw std::invalid_argument(
        fmt::format("clean: found '{}', expected free-space, none or a known method", name));
  return cleaner;
}

std::map<std::string, std::uint64_t> object_counts(const std::vector<maps::MapObject>& objects,
                                                   const Survey& survey, const ScanStages& stages) {
  std::map<std::string, std::uint64_t> counts{{"parked", 0}, {"moving", 0}};
  for (const maps::MapObject& object : objects) ++counts[std::string(name_of(object.motion))];
  counts["boxes"] = 0;
  for (const Survey::Scan& scan : survey.scans) counts["boxes"] += scan.boxes.size();
  for (const auto& [reason, count] : stages.dropped_boxes()) counts["dropped: " + reason] = count;
  return counts;
}

void write_text(const std::filesystem::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary);
  out << text << std::flush;
  if (!out) throw maps::StorageError(file.string(), "cannot be written");
}

void write_sources(maps::MapPackageWriter& writer, const DriveSet& drives, const Survey& survey,
                   const std::vector<maps::MapObject>& objects) {
  const std::vector<maps::Trajectory> trajectories = drives.trajectories();
  for (std::size_t i = 0; i < trajectories.size(); ++i) writer.write_trajectory(trajectories[i], i);
  writer.write_objects(objects);
  write_text(writer.folder() / "sources.sha256", survey.sources);
}

void report_speed(std::size_t scans, Clock::time_point began, MapBuildResult& report) {
  report.scans = scans;
  report.seconds = std::chrono::duration<double>(Clock::now() - began).count();
  report.scans_per_second = static_cast<double>(scans) / std::max(report.seconds, 1e-9);
  report.peak_rss_mib = maps::peak_rss_mib();
}

void report_edits(const EditResult& edits, MapBuildResult& report) {
  report.objects["edits_applied"] = edits.applied;
  report.objects["edits_unmatched"] = edits.unmatched.size();
  for (const std::string& edit : edits.unmatched)
    report.warnings.push_back("edit met nothing: " + edit);
}

/// What threw the poses away throws the survey away too, and is said once.
void warn_of_discarded(const BuildJournal& journal, MapBuildResult& report) {
  if (!journal.discarded().empty() && report.warnings.empty())
    report.warnings.push_back("work of a killed build was thrown away: " + journal.discarded());
}

void warn_of_near_points(double min_range_m, MapBuildResult& report) {
  const auto count = [&](const char* name) { return static_cast<double>(report.points.at(name)); };
  const double returned = count("in") - count("dropped_non_finite") - count("dropped_zero_range");
  const double too_near = count("dropped_too_near");
  if (!(too_near > kMostTooNear * returned)) return;
  report.warnings.push_back(fmt::format(
      "{:.0f} % of the points are left out, nearer than --min-range {} m; it is meant for what "
      "carries the sensor: give how far that reaches, or DRIVE?sensor=NAME",
      100.0 * too_near / returned, min_range_m));
}

/// Counts neighbours that are apart; exact poses that are not exact make a map whose walls stand
/// twice.
void warn_of_given_poses(double voxel_size_m, MapBuildResult& report) {
  auto& given = report.given_poses;
  if (!given) return;
  given->neighbours_apart = static_cast<std::size_t>(std::ranges::count_if(
      given->errors.neighbours_m, [&](double apart_m) { return apart_m > voxel_size_m; }));
  if (given->use == GivenPosesUse::kRefine && given->errors.denied > 0)
    report.warnings.push_back(
        fmt::format("{} of {} given poses (one in 10 m was compared) disagree with the scans; "
                    "check the drive's "
                    "trajectory, or build with --odometry default --gnss-sigma METRES",
                    given->errors.denied, given->errors.asked));
  if (given->use != GivenPosesUse::kExact || given->neighbours_apart == 0) return;
  const PoseDifferences& neighbours = given->errors.by_way.front();
  report.warnings.push_back(fmt::format(
      "{} of {} scans lie more than a voxel ({} m) from where the scan before them says, by the "
      "given poses: {:.2f} m at most, {:.3f} m in the median; build with --given-poses refine",
      given->neighbours_apart, neighbours.pairs, voxel_size_m, neighbours.max_m,
      neighbours.median_m));
}

/// Numbers of scans in their drive, the first ones of them.
std::string first_scans(const DriveSet& drives, std::span<const std::size_t> scans) {
  constexpr std::size_t kNamed = 5;
  std::string text = scans.size() == 1 ? "scan " : "scans ";
  for (std::size_t i = 0; i < std::min(scans.size(), kNamed); ++i)
    text += fmt::format("{}{} ({})", i == 0 ? "" : ", ", drives.place(scans[i]).index,
                        drives.name(scans[i]));
  return scans.size() > kNamed ? text + ", ..." : text;
}

void warn_of_hidden_scans(const DriveSet& drives, MapBuildResult& report) {
  std::vector<std::size_t> hidden, anew;
  for (std::size_t scan = 0; scan < drives.size(); ++scan) {
    if (drives.note(scan) == ScanNote::kHidden) hidden.push_back(scan);
    if (drives.note(scan) == ScanNote::kBeginsAnew) anew.push_back(scan);
  }
  if (!hidden.empty())
    report.warnings.push_back(fmt::format(
        "{} of {} scans show nothing of what the scans around them show, as of a covered sensor, "
        "of dust, or of a frame that was sent again; they are left out of the map, and placed by "
        "motion where no poses are given; look at {}, and clean or repair the sensor",
        hidden.size(), drives.size(), first_scans(drives, hidden)));
  if (!anew.empty())
    report.warnings.push_back(fmt::format(
        "odometry lost the place and restarted at {}: the motion before it is a guess; build the "
        "scans before and after as two drives (--select), or give poses",
        first_scans(drives, anew)));
}

/// One a pose of the map.
std::vector<maps::PoseDisagreement> of_poses(
    const DriveSet& drives, const std::vector<std::vector<maps::PoseDisagreement>>& of_drives) {
  std::vector<maps::PoseDisagreement> found(drives.size());
  for (std::size_t scan = 0; scan < found.size() && !of_drives.empty(); ++scan)
    found[scan] = of_drives.at(drives.place(scan).drive).at(drives.place(scan).index);
  return found;
}

void warn_of_bent_places(const DriveSet& drives,
                         std::span<const maps::PoseDisagreement> disagreements,
                         MapBuildResult& report) {
  const maps::BentPlaces bent = maps::bent_places(disagreements);
  const bool is_exact = report.given_poses && report.given_poses->use == GivenPosesUse::kExact;
  const bool is_said = is_exact && report.given_poses->neighbours_apart > 0;
  if (bent.poses == 0 || is_said) return;
  report.warnings.push_back(fmt::format(
      "the map is bent or torn around {} of {} scans, most around {}: poses there disagree by "
      "{:.2f} m with the motion that the scans show over 10 m; {}",
      bent.poses, disagreements.size(), first_scans(drives, std::array{bent.worst}), bent.worst_m,
      is_exact ? "build with --given-poses refine"
               : "look at the map there, and drive there again where walls stand twice"));
}

void warn_of_pose_faults(std::vector<maps::DriveFinding> faults, MapBuildResult& report) {
  for (const maps::DriveFinding& fault : faults)
    report.warnings.push_back(fault.what + "; " + fault.remedy);
  report.pose_faults = std::move(faults);
}

/// Says what was added.
void warn_of_found_offsets(const std::vector<maps::Drive>& drives, MapBuildResult& report) {
  for (std::size_t i = 0; i < report.found_pose_time_offsets_s.size(); ++i) {
    const double offset_s = report.found_pose_time_offsets_s[i];
    if (offset_s == 0.0) continue;
    report.warnings.push_back(fmt::format(
        "{}: {:.3f} s were added to the stamps of the poses, as the scans' motion tells "
        "(--pose-time-offset auto)",
        drives[i].contents().root.string(), offset_s));
  }
}

/// Drives as they were opened, and what was done to their poses.
struct OpenedDrives {
  std::vector<maps::Drive> drives;
  std::vector<double> found_offsets_s{};

  /// Added to the stamps of each drive's poses.
  [[nodiscard]] std::vector<double> applied_offsets_s(const MapBuildOptions& options) const {
    std::vector<double> applied_s(drives.size(), options.pose_time_offset_s);
    for (std::size_t i = 0; i < found_offsets_s.size(); ++i) applied_s[i] += found_offsets_s[i];
    return applied_s;
  }
};

/// Poses of all drives in one frame, or those that a killed build had found.
PosedDrives with_journaled_poses(const OpenedDrives& opened, const MapBuildOptions& options,
                                 const std::string& odometry, const Folders& folders,
                                 MapBuildResult& report, const ProgressCallback& progress,
                                 const CancelFlag& cancel) {
  const std::vector<maps::Drive>& drives = opened.drives;
  BuildJournal journal(folders.journal, "trajectory", trajectory_key(drives, options, odometry));
  if (journal.is_complete()) {
    try {
      if (const auto bytes = journal.read(0)) return posed_drives_from(*bytes, drives);
    } catch (const std::invalid_argument& error) {
      journal.discard(error.what());
    }
  }
  journal.keep(0);
  warn_of_discarded(journal, report);
  const StageTimer timer(report.stage_seconds, "trajectory");
  const std::vector<double> applied_s = opened.applied_offsets_s(options);
  PosedDrives posed =
      odometry == "given"
          ? with_given_poses(drives, options, applied_s, folders.scratch, progress, cancel)
          : with_estimated_poses(drives, options, odometry, applied_s, folders.scratch, progress,
                                 cancel);
  journal.append(to_bytes(posed));
  journal.complete();
  return posed;
}

/// Moves the poses into the frame of the map that the options name, if they name one.
std::optional<BuildFrame> register_drives(PosedDrives& posed, const MapBuildOptions& options,
                                          const std::string& odometry, MapBuildResult& report,
                                          const ProgressCallback& progress,
                                          const CancelFlag& cancel) {
  if (!options.register_to) return std::nullopt;
  const StageTimer timer(report.stage_seconds, "register");
  RegisteredDrives registered = registered_to(*options.register_to, posed.drives, options, odometry,
                                              posed.notes, progress, cancel);
  posed.drives = std::move(registered.drives);
  report.registration = registered.frame.registration;
  return std::move(registered.frame);
}

/// What motion says of the clocks, or a killed build had found.
std::vector<double> journaled_offsets_s(const std::vector<maps::Drive>& drives,
                                        const MapBuildOptions& options, const Folders& folders,
                                        MapBuildResult& report, const ProgressCallback& progress,
                                        const CancelFlag& cancel) {
  BuildJournal journal(folders.journal, "pose_time_offset",
                       trajectory_key(drives, options, "pose time offset"));
  if (const auto known = journal.is_complete() ? journal.read(0) : std::nullopt) {
    std::istringstream stream(*known);
    std::vector<double> offsets_s{std::istream_iterator<double>(stream), {}};
    if (offsets_s.size() == drives.size()) return offsets_s;
    journal.discard("not one offset a drive");
  }
  journal.keep(0);
  const StageTimer timer(report.stage_seconds, "pose time offset");
  std::vector<double> offsets_s = found_pose_time_offsets(drives, options, progress, cancel);
  journal.append(fmt::format("{}", fmt::join(offsets_s, " ")));
  journal.complete();
  return offsets_s;
}

/// Shifts poses in time where the options ask for it and poses are used.
OpenedDrives shifted_in_time(const std::vector<maps::Drive>& drives, const MapBuildOptions& options,
                             const std::string& odometry, const Folders& folders,
                             MapBuildResult& report, const ProgressCallback& progress,
                             const CancelFlag& cancel) {
  if (!options.finds_pose_time_offset || !uses_given_poses(odometry, options)) return {drives};
  const std::vector<double> offsets_s =
      journaled_offsets_s(drives, options, folders, report, progress, cancel);
  return {shifted_by(offsets_s, folders.drives, drives, options), offsets_s};
}

void warn_of_useless_offset(const MapBuildOptions& options, const std::string& odometry,
                            MapBuildResult& report) {
  const bool is_asked = options.finds_pose_time_offset || options.pose_time_offset_s != 0.0;
  if (!is_asked || uses_given_poses(odometry, options)) return;
  report.warnings.push_back(
      fmt::format("--pose-time-offset has no effect: --odometry {} does not use the given poses; "
                  "leave it out, or give --pose-sigma or --gnss-sigma",
                  odometry));
}

MapBuildResult build_into(maps::MapPackageWriter& writer, const Folders& folders,
                          const std::vector<maps::Drive>& unshifted, const MapBuildOptions& options,
                          const Cleaner* cleaner, const ProgressCallback& progress,
                          const CancelFlag& cancel) {
  const Clock::time_point began = Clock::now();
  const std::string odometry = odometry_of(unshifted, options);
  const maps::Edits edits =
      options.edits_file ? maps::read_edits(*options.edits_file) : maps::Edits{};
  const std::filesystem::path& scratch = folders.scratch;
  std::filesystem::create_directory(scratch);
  MapBuildResult report;
  const OpenedDrives opened =
      shifted_in_time(unshifted, options, odometry, folders, report, progress, cancel);
  report.found_pose_time_offsets_s = opened.found_offsets_s;
  PosedDrives posed =
      with_journaled_poses(opened, options, odometry, folders, report, progress, cancel);
  report.trajectory = std::move(posed.counts);
  report.given_poses = posed.given;
  warn_of_useless_offset(options, odometry, report);
  warn_of_found_offsets(unshifted, report);
  warn_of_given_poses(options.voxel_size_m, report);
  warn_of_pose_faults(std::move(posed.faults), report);
  const std::optional<BuildFrame> frame =
      register_drives(posed, options, odometry, report, progress, cancel);
  const DriveSet drives(std::move(posed.drives), options, std::move(posed.doubts),
                        std::move(posed.notes));
  warn_of_hidden_scans(drives, report);
  const std::vector<maps::PoseDisagreement> disagreements = of_poses(drives, posed.disagreements);
  warn_of_bent_places(drives, disagreements, report);
  const VoxelGrid grid(origin_of(drives, frame), options.voxel_size_m);
  ScanStages stages(drives, options, grid);
  stages.learn(cancel);
  std::vector<std::size_t> learned = ScanStages::learned_scans(drives);
  for (const auto& [scan, before] : ScanStages::vehicle_samples(drives))
    learned.insert(learned.end(), {scan, before});
  BuildJournal journal(folders.journal, "survey",
                       survey_key(drives, options, odometry, frame, learned));

  std::vector<maps::MapObject> map_objects;
  {
    const auto survey =
        survey_scans(drives, stages, scratch, options.threads, journal, progress, cancel);
    add_to(report.stage_seconds, survey->stage_seconds);
    report.resumed_scans = survey->resumed;
    warn_of_discarded(journal, report);
    BuildObjects objects;
    {
      const StageTimer timer(report.stage_seconds, "fuse");
      if (progress) progress("fuse", 0, 1);
      objects = objects_of(drives, *survey, options, grid.origin(), edits, cancel);
      if (cancel) throw Cancelled();
      survey->ground.finish(footprints_of(objects.objects, grid.origin()));
      if (progress) progress("fuse", 1, 1);
    }
    const FusedGround* ground = options.fusion ? &survey->ground : nullptr;
    const auto placed = place_scans(drives, stages, *survey, objects, ground, writer, scratch,
                                    options.threads, progress, cancel);
    map_objects = to_map_objects(drives, objects.objects, placed->points_removed, options.fusion);
    const TileCounts tiles = finish_tiles(drives, *survey, objects, *placed, grid, options, edits,
                                          cleaner, writer, progress, cancel);
    for (const Counts& counts : {survey->counts, placed->counts, tiles.counts})
      add_to(report.points, counts);
    warn_of_near_points(options.min_range_m, report);
    add_to(report.stage_seconds, placed->stage_seconds);
    add_to(report.stage_seconds, tiles.stage_seconds);
    report.consistency = tiles.consistency;
    report.objects = object_counts(map_objects, *survey, stages);
    report_edits(objects.edits, report);
    write_sources(writer, drives, *survey, map_objects);
    if (posed.graph) maps::write_map_graph(writer.folder(), map_graph_of(drives, *posed.graph));
    maps::write_pose_disagreements(writer.folder(), disagreements);
  }
  std::filesystem::remove_all(scratch);
  if (cancel) throw Cancelled();
  if (progress) progress("publish", 0, 1);
  report_speed(drives.size(), began, report);
  report.digest = writer.publish(
      manifest_of(drives, options, odometry, frame, grid.origin(), report), to_json(report));
  return report;
}

}  // namespace

std::string_view name_of(GivenPosesUse use) {
  return use == GivenPosesUse::kRefine ? "refine" : "exact";
}

std::vector<std::string> MapBuildOptions::violations() const {
  std::vector<std::string> broken = projection.violations();
  const auto check = [&](const char* name, double value, double least, double most) {
    if (!(value >= least && value <= most))
      broken.push_back(fmt::format("{}: {}, expected in [{}, {}]", name, value, least, most));
  };
  check("voxel_size_m", voxel_size_m, 0.02, 2.0);
  check("min_range_m", min_range_m, 0.0, 20.0);
  check("max_range_m", max_range_m, 5.0, 300.0);
  check("threads", threads, 0, 256);
  check("pose_time_offset_s", pose_time_offset_s, -1e9, 1e9);
  if (geodetic_origin)
    for (const std::string& each : maps::violations(*geodetic_origin)) broken.push_back(each);
  if (held_back_every == 1)
    broken.emplace_back("held_back_every: 1, expected 0 (none) or at least 2");
  if (ground.sensor_height_m) check("sensor_height_m", *ground.sensor_height_m, 0.1, 10.0);
  if (!(max_range_m > min_range_m))
    broken.push_back(
        fmt::format("max_range_m: {}, expected > min_range_m ({})", max_range_m, min_range_m));
  for (const std::string& each : trajectory.violations()) broken.push_back(each);
  if (edits_file && !fusion)
    broken.emplace_back("edits_file: found without fusion, expected fusion on");
  return broken;
}

std::vector<std::size_t> MapBuildOptions::scans_of(std::size_t size) const {
  std::vector<std::size_t> scans = selection.indices(size);
  const std::vector<std::size_t> held_back = held_back_of(size);
  std::erase_if(scans, [&](std::size_t scan) {
    return std::binary_search(held_back.begin(), held_back.end(), scan);
  });
  return scans;
}

std::vector<std::size_t> MapBuildOptions::held_back_of(std::size_t size) const {
  std::vector<std::size_t> held_back;
  if (held_back_every < 2) return held_back;
  const std::vector<std::size_t> selected = selection.indices(size);
  for (std::size_t i = held_back_every - 1; i + 1 < selected.size(); i += held_back_every)
    held_back.push_back(selected[i]);
  return held_back;
}

MapBuildOptions completed(MapBuildOptions options) {
  // Sides of a network's boxes are right in the median, so half of what stands on them lies
  // outside.
  constexpr double kNetworkMarginM = 0.2;
  if (options.detector.starts_with(kVoxelNextDetector) || options.detector.starts_with("onnx:")) {
    double& margin_m = options.projection.margin_m;
    margin_m = std::max(margin_m, kNetworkMarginM);
  }
  return options;
}

void apply_paper_preset(MapBuildOptions& options) {
  options.fusion = false;
  options.fill = false;
  options.clean = "none";
  options.given_poses = GivenPosesUse::kExact;
  options.projection.ground_height = GroundHeight::kMean;
}

bool estimates_poses(const std::vector<std::filesystem::path>& drives,
                     const MapBuildOptions& options) {
  return odometry_of(open_drives(drives, options), options) != "given";
}

MapBuildResult build_map(const std::vector<std::filesystem::path>& folders,
                         const std::filesystem::path& target, const MapBuildOptions& given,
                         const ProgressCallback& progress, const CancelFlag& cancel,
                         const CleanerFactory& make_cleaner) {
  const MapBuildOptions options = completed(given);
  if (const auto broken = options.violations(); !broken.empty())
    throw std::invalid_argument("build options: " + broken.front());
  const std::unique_ptr<Cleaner> cleaner = cleaner_of(options.clean, make_cleaner);
  const std::vector<maps::Drive> drives = open_drives(folders, options);
  maps::MapPackageWriter writer(target, options.journal_folder ? "" : kJournalFolder);
  const Folders at{folders, options.journal_folder.value_or(writer.folder() / kJournalFolder),
                   writer.folder() / kScratchFolder};
  try {
    return build_into(writer, at, drives, options, cleaner.get(), progress, cancel);
  } catch (const Cancelled&) {
    throw;
  } catch (const std::bad_alloc&) {
    // With more memory the same command goes on.
    throw;
  } catch (...) {
    std::error_code ignored;
    if (!options.journal_folder) std::filesystem::remove_all(at.journal, ignored);
    throw;
  }
}

}  // namespace stillmap::mapping

#include "odometry/imu_clock.hpp"
#include "pipeline/build.hpp"
#include "pipeline/manifest.hpp"
#include "pipeline/opened_drives.hpp"

#include <fmt/format.h>
#include <stillmap/mapping/detector.hpp>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/edits.hpp>
#include <stillmap/maps/geodesy.hpp>
#include <stillmap/maps/map_package.hpp>

#include <algorithm>
#include <new>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

/// In the package while it is written: what outlives a kill.
constexpr const char* kJournalFolder = "journal";
constexpr const char* kScratchFolder = "scratch";

/// A build, from drives to a map.
constexpr Stage kStages[] = {
    shift_poses,     // drives -> poses at the right time
    find_poses,      // -> poses in one frame, compared with the scans' own motion
    register_poses,  // -> poses in the frame of another map
    select_scans,    // -> the scans of the map, its voxels
    survey_scans,    // each scan: read, drop, deskew, ground, detect
    fuse_objects,    // objects and ground of all scans
    place_scans,     // each scan from its points: project, stack
    finish_tiles,    // each tile: clean, fill, normals
    write_package,   // objects, sources, graph, manifest
};

std::unique_ptr<Cleaner> cleaner_of(const std::string& name, const CleanerFactory& make_cleaner) {
  if (name == "free-space" || name == "none") return nullptr;
  auto cleaner = make_cleaner ? make_cleaner(name) : nullptr;
  if (!cleaner)
    throw std::invalid_argument(
        fmt::format("clean (--clean): found '{}', expected free-space, none or a method that "
                    "`stillmap build --help` lists",
                    name));
  return cleaner;
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
  check("voxel_size_m (--voxel)", voxel_size_m, 0.02, 2.0);
  check("min_range_m (--min-range)", min_range_m, 0.0, 20.0);
  check("max_range_m (--max-range)", max_range_m, 5.0, 300.0);
  check("threads (--threads)", threads, 0, 256);
  check("pose_time_offset_s (--pose-time-offset)", pose_time_offset_s, -1e9, 1e9);
  if (geodetic_origin)
    for (const std::string& each : maps::violations(*geodetic_origin)) broken.push_back(each);
  if (held_back_every == 1)
    broken.emplace_back("held_back_every (--held-back-every): 1, expected 0 (none) or at least 2");
  if (ground.sensor_height_m)
    check("sensor_height_m (--sensor-height)", *ground.sensor_height_m, 0.1, 10.0);
  if (!(max_range_m > min_range_m))
    broken.push_back(fmt::format(
        "max_range_m (--max-range): {}, expected more than min_range_m (--min-range), which is {}",
        max_range_m, min_range_m));
  for (const std::string& each : trajectory.violations()) broken.push_back(each);
  if (edits_file && !fusion)
    broken.emplace_back(
        "edits_file (--edits): found without fusion, expected fusion on (--fusion on)");
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

MapBuildOptions usable(const MapBuildOptions& given) {
  MapBuildOptions options = completed(given);
  if (const auto broken = options.violations(); !broken.empty())
    throw std::invalid_argument("build options: " + broken.front());
  return options;
}

DrivesOfBuild open_for_build(const std::vector<std::filesystem::path>& folders,
                             const MapBuildOptions& options, const ProgressCallback& progress,
                             const CancelFlag& cancel) {
  DrivesOfBuild opened{open_drives(folders, options), {}};
  for (maps::Drive& drive : opened.drives) {
    const std::size_t own = drive.contents().notes.size();
    drive = with_fitted_imu(drive, options.threads, progress, cancel);
    const std::vector<std::string>& all = drive.contents().notes;
    for (std::size_t i = own; i < all.size(); ++i)
      opened.notes.push_back(fmt::format("{}: {}", drive.contents().root.string(), all[i]));
  }
  return opened;
}

MapBuildResult build_map(const std::vector<std::filesystem::path>& folders,
                         const std::filesystem::path& target, const MapBuildOptions& given,
                         const ProgressCallback& progress, const CancelFlag& cancel,
                         const CleanerFactory& make_cleaner) {
  const MapBuildOptions options = usable(given);
  const std::unique_ptr<Cleaner> cleaner = cleaner_of(options.clean, make_cleaner);
  DrivesOfBuild opened = open_for_build(folders, options, progress, cancel);
  maps::MapPackageWriter writer(target, options.journal_folder ? "" : kJournalFolder);
  const std::filesystem::path journal_folder =
      options.journal_folder.value_or(writer.folder() / kJournalFolder);
  try {
    const BuildTask task{
        .options = options,
        .odometry = odometry_of(opened.drives, options),
        .folders = folders,
        .drives = opened.drives,
        .journal_folder = journal_folder,
        .scratch = writer.folder() / kScratchFolder,
        .edits = options.edits_file ? maps::read_edits(*options.edits_file) : maps::Edits{},
        .cleaner = cleaner.get(),
        .writer = &writer,
        .progress = progress,
        .cancel = cancel};
    std::filesystem::create_directory(task.scratch);
    Build build(task);
    build.result.notes = std::move(opened.notes);
    for (const Stage stage : kStages) stage(build);
    return std::move(build.result);
  } catch (const Cancelled&) {
    throw;
  } catch (const std::bad_alloc&) {
    // With more memory the same command goes on.
    throw;
  } catch (...) {
    std::error_code ignored;
    if (!options.journal_folder) std::filesystem::remove_all(journal_folder, ignored);
    throw;
  }
}

}  // namespace stillmap::mapping

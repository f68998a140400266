#include "core/ordered_pipeline.hpp"
#include "pipeline/build.hpp"
#include "pipeline/build_key.hpp"
#include "pipeline/finish_stage.hpp"
#include "pipeline/map_build_json.hpp"
#include "pipeline/opened_drives.hpp"
#include "pipeline/tile_window.hpp"
#include "units/finished_records.hpp"
#include "units/fused_records.hpp"
#include "units/journaled_views.hpp"
#include "units/unit_lock.hpp"
#include "units/unit_regions.hpp"

#include <stillmap/mapping/build_units.hpp>
#include <stillmap/maps/edits.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/hidden_beside.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

namespace fs = std::filesystem;
using Kind = BuildUnit::Kind;

bool has_shares(Kind kind) { return kind == Kind::kSurvey || kind == Kind::kFinish; }

std::string_view name_of(Kind kind) {
  switch (kind) {
    case Kind::kPoses:
      return "poses";
    case Kind::kSurvey:
      return "survey";
    case Kind::kFuse:
      return "fuse";
    case Kind::kFinish:
      return "finish";
    case Kind::kMerge:
      return "merge";
  }
  throw std::logic_error("a unit of no kind");
}

BuildUnit unit_from(std::string_view text, std::size_t units) {
  const std::size_t colon = text.find(':');
  for (const Kind kind : {Kind::kPoses, Kind::kSurvey, Kind::kFuse, Kind::kFinish, Kind::kMerge}) {
    if (text.substr(0, colon) != name_of(kind)) continue;
    BuildUnit unit{kind};
    if (has_shares(kind) != (colon != std::string_view::npos)) break;
    if (!has_shares(kind)) return unit;
    const std::string_view number = text.substr(colon + 1);
    const auto [end, error] =
        std::from_chars(number.data(), number.data() + number.size(), unit.number);
    if (error != std::errc() || end != number.data() + number.size() || unit.number < 1 ||
        unit.number > units)
      break;
    return unit;
  }
  throw std::invalid_argument(
      fmt::format("unit (--unit): found '{}', expected poses, survey:N, fuse, finish:N or merge, N "
                  "from 1 to {} (--units)",
                  text, units));
}

/// Poses and scans as the unit `poses` left them.
void take_scans(Build& build) {
  shift_poses(build);
  find_poses(build);
  register_poses(build);
  select_scans(build);
}

std::string finished_stage_name(std::size_t number, std::size_t units) {
  return fmt::format("finish_{}_of_{}", number, units);
}

std::string finished_key(const std::string& fused_key, const BuildJournal& fused) {
  return fmt::format("fused: {}\n", fused.sum()) + fused_key;
}

/// What `fuse` wrote.
struct FusedJournal {
  FusedJournal(const Build& build, const SurveyRecords& records, std::size_t units)
      : key(fused_key(build, records, units)),
        journal(build.task.journal_folder, "fuse", key, BuildJournal::Use::kRead) {
    journal.require_complete("fuse");
  }
  std::string key;
  BuildJournal journal;
};

void fuse(Build& build, std::size_t units) {
  take_scans(build);
  const SurveyRecords records(build, units);
  BuildJournal journal(build.task.journal_folder, "fuse", fused_key(build, records, units));
  if (journal.is_complete()) return;
  journal.keep(0);
  gather_survey(build, [&](std::size_t scan) { return records.read_checked(scan); });
  fuse_objects(build);
  write_fused(build, journal);
}

/// The other units know by their reach which scans they need.
void require_within_reach(const Build& build, const PlacedScan& scan) {
  const std::size_t number = scan.voxels.scan();
  const Eigen::Vector2f p = (build.drives->T_map_scan(number).translation() - build.grid->origin())
                                .head<2>()
                                .cast<float>();
  const double reach = reach_m(build, number);
  for (const auto& [tile, voxels] : scan.voxels.tiles()) {
    if (static_cast<double>(area_of(tile).exteriorDistance(p)) > reach)
      throw maps::InputError(
          build.drives->name(number), fmt::format("points more than {:.0f} m from its pose", reach),
          "nearer ones, as poses without jumps give: repair the poses, or build without --unit");
  }
}

/// Places the scans that see a share of the regions.
void place_share(Build& build, const UnitRegions& share, FinishedWriter& writer) {
  const BuildTask& task = build.task;
  const BuildObjects& objects = build.objects;
  const FusedGround* ground = task.options.fusion ? &build.survey->ground : nullptr;
  const PosedViews views = posed_views(*build.drives, *build.survey, build.grid->origin());
  const auto needs = [&](maps::TileId tile) { return share.needs(tile); };
  std::size_t done = 0;
  process_in_order(
      share.scans.size(), task.options.threads,
      [&](std::size_t i) {
        const std::size_t scan = share.scans[i];
        return build.scan_work->place(
            {scan, build.survey->found(scan), objects.by_scan[scan], objects.kept_by_scan[scan]},
            ground, views);
      },
      [&](const PlacedScan& scan) {
        build.placed->stack.add(scan.voxels, needs);
        if (share.own_scans.contains(scan.voxels.scan())) {
          require_within_reach(build, scan);
          writer.add(scan);
        }
        if (++done % kRestScans == 0) build.survey->ground.rest();
        build.tell("place", done, share.scans.size());
      },
      task.cancel);
}

void finish_share(Build& build, std::size_t number, std::size_t units) {
  take_scans(build);
  const SurveyRecords records(build, units);
  const FusedJournal fused(build, records, units);
  BuildJournal journal(build.task.journal_folder, finished_stage_name(number, units),
                       finished_key(fused.key, fused.journal));
  if (journal.is_complete()) return;
  journal.keep(0);
  FinishedWriter writer(journal);
  const UnitRegions share = regions_of_units(build, units)[number - 1];
  if (!share.scans.empty()) {
    read_fused(build, fused.journal, share.ground);
    const JournaledViews views(records, build.survey->views);
    build.survey->found = [&](std::size_t scan) { return views.found(scan); };
    build.survey->view = [&](std::size_t scan) { return views.view(scan); };
    build.scan_work.emplace(*build.drives, build.task.options, *build.grid);
    build.scan_work->learn({share.scans.front(), share.scans.back() + 1}, build.task.cancel);
    build.placed = std::make_unique<Placed>(build.task.scratch);
    place_share(build, share, writer);
    std::vector<RegionTiles> regions = regions_of(build.placed->stack.tiles());
    std::erase_if(regions, [&](const RegionTiles& region) {
      return !share.regions.contains(maps::region_of(region.own.front()));
    });
    std::size_t tiles = 0, done = 0;
    for (const RegionTiles& region : regions) tiles += region.own.size();
    finish_regions(build, regions, build.placed->stack, nullptr, [&](const FinishedTile& tile) {
      writer.add(tile);
      build.tell("tiles", ++done, tiles);
    });
  }
  writer.finish();
}

/// What the finish units of a build wrote.
class FinishedShares {
 public:
  FinishedShares(const Build& build, const FusedJournal& fused, std::size_t units)
      : shares_(regions_of_units(build, units)) {
    const std::string key = finished_key(fused.key, fused.journal);
    for (std::size_t number = 1; number <= units; ++number) {
      const std::string unit = mapping::name_of(BuildUnit{Kind::kFinish, number});
      journals_.push_back(std::make_unique<BuildJournal>(build.task.journal_folder,
                                                         finished_stage_name(number, units), key,
                                                         BuildJournal::Use::kRead));
      journals_.back()->require_complete(unit);
      readers_.emplace_back(*journals_.back(), *build.grid, unit);
    }
  }

  [[nodiscard]] PlacedScan next_scan(std::size_t scan) {
    for (std::size_t i = 0; i < shares_.size(); ++i)
      if (shares_[i].own_scans.contains(scan)) return readers_[i].next_scan(scan);
    throw std::logic_error(fmt::format("merge: no unit answers for scan {}", scan));
  }
  [[nodiscard]] const std::vector<FinishedReader>& readers() const { return readers_; }
  /// Of all that the map is made from.
  [[nodiscard]] std::string sum() const {
    std::string sums;
    for (const auto& journal : journals_) sums += journal->sum();
    return maps::sha256_of(sums);
  }

 private:
  std::vector<UnitRegions> shares_;
  std::vector<std::unique_ptr<BuildJournal>> journals_;
  std::vector<FinishedReader> readers_;
};

void merge_scans(Build& build, FinishedShares& shares) {
  const BuildTask& task = build.task;
  build.placed = std::make_unique<Placed>(task.scratch);
  task.writer->set_drives(drive_counts(*build.drives, build.objects));
  for (std::size_t number = 0; number < build.drives->size(); ++number) {
    build.stop_if_cancelled();
    const PlacedScan scan = shares.next_scan(number);
    task.writer->add_fates(scan.fates);
    add_to(build.placed->points_removed, scan.points_removed);
    add_to(build.result.points, scan.counts);
    add_to(build.result.stage_seconds, scan.stage_seconds);
    build.tell("place", number + 1, build.drives->size());
  }
}

void merge_tiles(Build& build, const FinishedShares& shares) {
  std::vector<maps::TileId> ids;
  for (const FinishedReader& reader : shares.readers())
    ids.insert(ids.end(), reader.tiles().begin(), reader.tiles().end());
  std::ranges::sort(ids);
  MapOfTiles map(build, ids);
  for (const FinishedReader& reader : shares.readers()) {
    for (std::size_t i = 0; i < reader.tiles().size(); ++i) {
      build.stop_if_cancelled();
      map.take(reader.tile(i));
    }
  }
  map.finish();
}

/// What the map at a place was merged from; empty for one that was made otherwise.
std::string merged_from(const fs::path& map) {
  std::ifstream stream(map / "build.json");
  const auto json = nlohmann::json::parse(stream, nullptr, false);
  return json.is_object() ? json.value("merged_from", std::string()) : std::string();
}

/// What the build of a map did that is there.
MapBuildResult result_of(const fs::path& map) {
  const fs::path file = map / "build.json";
  std::ifstream stream(file);
  try {
    MapBuildResult result = build_result_from({std::istreambuf_iterator<char>(stream), {}});
    // No file of a package holds it.
    result.digest = maps::MapPackage::open(map)->digest();
    return result;
  } catch (const std::invalid_argument& error) {
    throw maps::InputError(file.string(), error.what(), "the report of a build by this program");
  }
}

[[noreturn]] void refuse_existing(const fs::path& target) {
  throw maps::InputError(target.string(), "an existing path", "a new one: give another name");
}

/// Makes the map, unless it is there already.
void merge(Build& build, const fs::path& target, std::size_t units) {
  take_scans(build);
  {
    const SurveyRecords records(build, units);
    const FusedJournal fused(build, records, units);
    FinishedShares shares(build, fused, units);
    build.result.merged_from = shares.sum();
    if (build.task.writer == nullptr) {
      if (merged_from(target) != build.result.merged_from) refuse_existing(target);
      // Killed before the folder of the units was removed.
      MapBuildResult result = result_of(target);
      result.notes = std::move(build.result.notes);
      build.result = std::move(result);
      return;
    }
    read_fused(build, fused.journal, std::nullopt);
    add_to(build.result.stage_seconds, build.survey->stage_seconds);
    add_to(build.result.points, build.survey->counts);
    // Knows the boxes that were given for nothing.
    build.scan_work.emplace(*build.drives, build.task.options, *build.grid);
    merge_scans(build, shares);
    merge_tiles(build, shares);
  }
  write_package(build);
}

void survey_share(Build& build, std::size_t number, std::size_t units) {
  take_scans(build);
  survey_range(build, share_of_scans(build.drives->size(), number, units),
               survey_stage_name(number, units));
}

void do_in(Build& build, const BuildUnit& unit, const fs::path& target, std::size_t units) {
  switch (unit.kind) {
    case Kind::kPoses:
      shift_poses(build);
      find_poses(build);
      return register_poses(build);
    case Kind::kSurvey:
      return survey_share(build, unit.number, units);
    case Kind::kFuse:
      return fuse(build, units);
    case Kind::kFinish:
      return finish_share(build, unit.number, units);
    case Kind::kMerge:
      return merge(build, target, units);
  }
}

/// Removes the folder in a way that nobody takes the rest of it for work that is not done.
void remove_units(const fs::path& folder, const fs::path& done) {
  fs::remove_all(done);
  fs::rename(folder, done);
  fs::remove_all(done);
}

}  // namespace

std::string name_of(const BuildUnit& unit) {
  return has_shares(unit.kind) ? fmt::format("{}:{}", name_of(unit.kind), unit.number)
                               : std::string(name_of(unit.kind));
}

std::vector<BuildUnit> units_from(std::string_view text, std::size_t units) {
  std::vector<BuildUnit> found;
  while (true) {
    const std::size_t comma = text.find(',');
    found.push_back(unit_from(text.substr(0, comma), units));
    if (comma == std::string_view::npos) return found;
    text.remove_prefix(comma + 1);
  }
}

std::vector<std::vector<BuildUnit>> unit_steps(std::size_t units) {
  std::vector<std::vector<BuildUnit>> steps;
  for (const Kind kind : {Kind::kPoses, Kind::kSurvey, Kind::kFuse, Kind::kFinish, Kind::kMerge}) {
    std::vector<BuildUnit>& step = steps.emplace_back();
    for (std::size_t number = 1; number <= (has_shares(kind) ? units : 1); ++number)
      step.push_back({kind, number});
  }
  return steps;
}

fs::path units_folder(const fs::path& target) { return maps::hidden_beside(target, ".units"); }

void require_usable_by_units(const MapBuildOptions& options, std::size_t units) {
  if (units < 1 || units > kMostUnits)
    throw std::invalid_argument(
        fmt::format("units (--units): found {}, expected 1 to {}", units, kMostUnits));
  if (options.clean != "free-space" && options.clean != "none")
    throw std::invalid_argument(
        fmt::format("clean (--clean): found '{}', which needs the whole map at once, expected "
                    "free-space or none; or build without --unit",
                    options.clean));
}

MapBuildResult do_unit(const std::vector<fs::path>& folders, const fs::path& target,
                       const MapBuildOptions& given, const BuildUnit& unit, std::size_t units,
                       const ProgressCallback& progress, const CancelFlag& cancel) {
  const MapBuildOptions options = usable(given);
  require_usable_by_units(options, units);
  const fs::path folder = options.journal_folder.value_or(units_folder(target));
  const fs::path done = maps::hidden_beside(target, ".units-done");
  const bool merges = unit.kind == Kind::kMerge;
  const bool is_there = fs::exists(fs::symlink_status(target));
  if (is_there && !merges) refuse_existing(target);
  if (is_there && !fs::exists(folder)) {
    if (merged_from(target).empty()) refuse_existing(target);
    MapBuildResult result = result_of(target);
    fs::remove_all(done);
    return result;
  }
  MapBuildResult result;
  {
    // Held until the folder is gone.
    const UnitLock lock(folder, mapping::name_of(unit));
    std::optional<maps::MapPackageWriter> writer;
    if (merges && !is_there) writer.emplace(target);
    DrivesOfBuild opened = open_for_build(folders, options, progress, cancel);
    const BuildTask task{
        .options = options,
        .odometry = odometry_of(opened.drives, options),
        .folders = folders,
        .drives = opened.drives,
        .journal_folder = folder,
        .scratch = lock.scratch(),
        .edits = options.edits_file ? maps::read_edits(*options.edits_file) : maps::Edits{},
        .cleaner = nullptr,
        .writer = writer ? &*writer : nullptr,
        .progress = progress,
        .cancel = cancel,
        .poses_journal =
            unit.kind == Kind::kPoses ? BuildJournal::Use::kContinue : BuildJournal::Use::kRead};
    Build build(task);
    build.result.notes = std::move(opened.notes);
    do_in(build, unit, target, units);
    if (!build.result.digest.empty())
      result = std::move(build.result);
    else
      result.warnings = std::move(build.result.warnings);
    if (merges && !options.journal_folder) remove_units(folder, done);
  }
  return result;
}

}  // namespace stillmap::mapping

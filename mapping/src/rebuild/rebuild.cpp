#include <stillmap/mapping/rebuild.hpp>

#include "core/stage_timer.hpp"
#include "pipeline/build_key.hpp"
#include "pipeline/opened_drives.hpp"
#include "rebuild/held_back.hpp"
#include "rebuild/map_comparison.hpp"
#include "rebuild/rebuild_work.hpp"

#include <fmt/format.h>
#include <sys/stat.h>
#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/peak_memory.hpp>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

/// The build that everything stays in: all points of the same scans, where they were measured.
MapBuildOptions keep_options(MapBuildOptions options) {
  options.projection.policy = MovablePolicy::kKeep;
  options.clean = "none";
  options.fusion = false;
  options.fill = false;
  options.edits_file.reset();
  return options;
}

/// Options as the builds use them.
RebuildOptions completed(RebuildOptions options) {
  options.build.held_back_every = options.held_back ? 0 : options.held_back_every;
  options.build.journal_folder = options.work / "journal";
  options.build.detect_always = true;
  if (options.previous) options.build.register_to = options.previous;
  options.build.follows_map = options.patch;
  return options;
}

void require_usable(const RebuildOptions& options) {
  if (!options.held_back && options.held_back_every < 2)
    throw std::invalid_argument(fmt::format(
        "held_back_every (--held-back-every): {}, expected at least 2", options.held_back_every));
  if (options.build.finds_pose_time_offset)
    throw std::invalid_argument(
        "--pose-time-offset: auto is not possible in a rebuild; run 'stillmap inspect DRIVE "
        "--motion' and pass the seconds that it names");
  if (options.previous && options.build.register_to)
    throw std::invalid_argument(
        "register_to (--register-to): found beside a previous version (--previous), expected one "
        "of them: leave one out");
  if (options.patch && !options.previous)
    throw std::invalid_argument(
        "patch (--patch): found without a previous version, expected --previous MAP: a patch is of "
        "a map");
  if (const auto broken = options.limits.violations(); !broken.empty())
    throw std::invalid_argument("gate limits: " + broken.front());
}

std::string key_of(const RebuildOptions& options) {
  const std::vector<maps::Drive> drives = open_drives(options.drives, options.build);
  std::string key = rebuild_key(drives, options.build, odometry_of(drives, options.build));
  key += fmt::format("previous: {}\n",
                     options.previous ? maps::MapPackage::open(*options.previous)->digest() : "");
  if (const auto& map = options.build.register_to)
    key += fmt::format("registered to: {}{}\n", maps::MapPackage::open(*map)->digest(),
                       options.build.follows_map ? ", followed" : "");
  if (options.patch)
    key += fmt::format("patch: {} m, {}\n", options.patch_options.most_seam_m,
                       options.patch_options.least_seen);
  if (options.held_back) {
    const std::vector<maps::Drive> judge{held_back_drive(options)};
    const MapBuildOptions whole;
    key += trajectory_key(judge, whole, "held back");
  }
  return key;
}

/// The last step is a rename.
void require_one_file_system(const fs::path& work, const fs::path& map) {
  const fs::path folder = fs::absolute(map).lexically_normal().parent_path();
  struct stat a {};
  struct stat b {};
  if (::stat(folder.c_str(), &b) != 0)
    throw maps::StorageError(folder.string(), std::strerror(errno));
  if (::stat(work.c_str(), &a) != 0) throw maps::StorageError(work.string(), std::strerror(errno));
  if (a.st_dev != b.st_dev)
    throw maps::InputError(work.string(), "another file system than " + folder.string(),
                           "the same: give a --work folder beside the map");
}

std::uint64_t bytes_of(const maps::MapPackage& map) {
  std::uint64_t bytes = fs::file_size(map.folder() / "manifest.json");
  for (const auto& [name, file] : map.manifest().files) bytes += file.bytes;
  return bytes;
}

std::size_t newly_lost(const std::string& before, const std::string& now) {
  std::size_t lost = 0;
  for (std::size_t i = 0; i < std::min(before.size(), now.size()); ++i)
    lost += before[i] == 'o' && now[i] == 'l' ? 1 : 0;
  return lost;
}

std::string text_of(const StaticLoss& loss) { return fmt::format("{} {}", loss.points, loss.lost); }

std::string text_of(const GroundCoverage& coverage) {
  return fmt::format("{:.17g} {:.17g} {} {}", coverage.driven, coverage.near_path,
                     coverage.driven_cells, coverage.near_path_cells);
}

StaticLoss loss_from(const std::string& text) {
  StaticLoss loss;
  std::istringstream(text) >> loss.points >> loss.lost;
  return loss;
}

GroundCoverage coverage_from(const std::string& text) {
  GroundCoverage coverage;
  std::string driven, near_path;
  std::istringstream(text) >> driven >> near_path >> coverage.driven_cells >>
      coverage.near_path_cells;
  // A stream does not read "nan".
  coverage.driven = std::stod(driven);
  coverage.near_path = std::stod(near_path);
  return coverage;
}

std::string text_of(const ConsistencyChange& change) {
  std::string text;
  for (const MapConsistency* each : {&change.previous, &change.map}) {
    text += fmt::format("{:.17g} {} ", each->mean_map_entropy, each->entropy_points);
    for (const SurfaceThickness* surface : {&each->walls, &each->ground})
      text += fmt::format("{} {} {:.17g} {:.17g} ", surface->cells, surface->planar_cells,
                          surface->median_m, surface->p95_m);
  }
  return text;
}

ConsistencyChange change_from(const std::string& text) {
  ConsistencyChange change;
  std::istringstream stream(text);
  const auto read = [&](double& value) {
    std::string word;
    stream >> word;
    // A stream does not read "nan".
    value = std::stod(word);
  };
  for (MapConsistency* each : {&change.previous, &change.map}) {
    read(each->mean_map_entropy);
    stream >> each->entropy_points;
    for (SurfaceThickness* surface : {&each->walls, &each->ground}) {
      stream >> surface->cells >> surface->planar_cells;
      read(surface->median_m);
      read(surface->p95_m);
    }
  }
  return change;
}

/// One rebuild from stage to stage.
class Rebuild {
 public:
  Rebuild(const RebuildOptions& options, const ProgressCallback& progress, const CancelFlag& cancel,
          const CleanerFactory& make_cleaner, const PackageMaker& make_package)
      : options_(options),
        progress_(progress),
        cancel_(cancel),
        make_cleaner_(make_cleaner),
        make_package_(make_package),
        work_(options.work, key_of(options)) {
    if (!work_.discarded().empty())
      report_.warnings.push_back("work of another rebuild was thrown away: " + work_.discarded());
  }

  RebuildResult run() {
    require_one_file_system(options_.work, options_.map);
    const fs::path place = built();
    const Maps all{maps::MapPackage::open(place), of_drives_alone(place), kept()};
    report_.digest = all.map->digest();
    report_.map_bytes = bytes_of(*all.map);
    add_warnings("map", *all.of_drives);
    report_.keep_digest = all.keep->digest();
    add_warnings("keep", *all.keep);
    // Both are built.
    std::error_code ignored;
    fs::remove_all(work_.path("journal"), ignored);
    ask(all);
    compare(all);
    decide_gate();
    publish(place);
    report_.peak_rss_mib = maps::peak_rss_mib();
    return std::move(report_);
  }

 private:
  struct Maps {
    /// The new version; that of the drives alone, which it is too unless it is a patch; and that of
    /// the drives in which everything stays.
    std::shared_ptr<const maps::MapPackage> map, of_drives, keep;
  };

  /// Tells of the stages of one part under a name of its own.
  [[nodiscard]] ProgressCallback under(const std::string& part) const {
    return [this, part](std::string_view stage, std::size_t done, std::size_t total) {
      if (progress_) progress_(part + ": " + std::string(stage), done, total);
    };
  }

  /// Does a part unless it was done before.
  /// @return what it came to.
  std::string part(const std::string& name, const std::function<std::string()>& work) {
    if (const auto known = work_.remembered(name)) {
      report_.resumed_stages.push_back(name);
      const std::size_t end = known->find('\n');
      report_.stage_seconds[name] = std::stod(known->substr(0, end));
      return known->substr(end + 1);
    }
    if (cancel_) throw Cancelled();
    const Clock::time_point began = Clock::now();
    std::string text = work();
    const double seconds = std::chrono::duration<double>(Clock::now() - began).count();
    report_.stage_seconds[name] = seconds;
    report_.work_bytes = std::max(report_.work_bytes, work_.bytes());
    work_.remember(name, fmt::format("{:.3f}\n{}", seconds, text));
    return text;
  }

  /// A package at its place. There it is whole, or not at all.
  std::string package(const std::string& name, const fs::path& at, const MapBuildOptions& options) {
    // Removed by somebody since.
    if (!fs::exists(at)) work_.forget(name);
    return part(name, [&] {
      if (!fs::exists(at) && make_package_)
        make_package_(name, at, under(name));
      else if (!fs::exists(at))
        (void)build_map(options_.drives, at, options, under(name), cancel_, make_cleaner_);
      return maps::MapPackage::open(at)->digest();
    });
  }

  /// What the build of a package warned of, in whatever process that was.
  void add_warnings(const std::string& name, const maps::MapPackage& package) {
    std::ifstream stream(package.folder() / "build.json");
    const auto json = nlohmann::json::parse(stream, nullptr, false);
    if (!json.is_object() || !json.contains("warnings"))
      throw maps::InputError((package.folder() / "build.json").string(), "no warnings",
                             "those of the build");
    for (const nlohmann::json& warning : json.at("warnings"))
      report_.warnings.push_back(name + ": " + warning.get<std::string>());
  }

  /// @return where the new map lies: at its place when only the report was missing.
  fs::path built() {
    const std::optional<std::string> done = work_.remembered("done");
    const bool published = done && fs::exists(options_.map);
    if (!published && fs::exists(fs::symlink_status(options_.map)))
      throw maps::InputError(options_.map.string(), "an existing path",
                             "a new one: give another name, or remove it");
    fs::path place = published ? options_.map : work_.path(options_.patch ? "patch" : "map");
    const std::string digest =
        options_.patch ? patched(place) : package("map", place, options_.build);
    if (published && (digest != *done || maps::MapPackage::open(place)->digest() != digest))
      throw maps::InputError(place.string(), "another map", "a new path: give another name");
    return place;
  }

  /// Makes the previous version with the drives in it. @return its digest.
  std::string patched(const fs::path& place) {
    (void)package("map", work_.path("map"), options_.build);
    if (!fs::exists(place)) work_.forget("patch");
    const std::string text = part("patch", [&] {
      // Of a process that was killed before it could say what came of it.
      if (place != options_.map) fs::remove_all(place);
      const auto previous = maps::MapPackage::open(*options_.previous);
      const auto drives = maps::MapPackage::open(work_.path("map"));
      PatchOptions options = options_.patch_options;
      options.threads = options_.build.threads;
      const PatchResult result =
          patch_map(*previous, *drives, place, options, under("patch"), cancel_);
      localization::MapIndex::begin_with(*maps::MapPackage::open(place), *previous);
      return to_json(result);
    });
    report_.patch = patch_result_from(text);
    return report_.patch->digest;
  }

  [[nodiscard]] std::shared_ptr<const maps::MapPackage> of_drives_alone(const fs::path& place) {
    return maps::MapPackage::open(options_.patch ? work_.path("map") : place);
  }

  /// Of a patch: the new tiles and those around them.
  [[nodiscard]] TileChoice judged(const Maps& all) const {
    if (!options_.patch) return {};
    std::set<maps::TileId> ids;
    const auto previous = maps::MapPackage::open(*options_.previous);
    for (const maps::TileId id : tiles_to_patch(*previous, *all.of_drives, options_.patch_options))
      for (int step = 0; step < 9; ++step)
        ids.insert({0, id.x + step % 3 - 1, id.y + step / 3 - 1});
    return [ids](maps::TileId id) { return ids.contains(id); };
  }

  std::shared_ptr<const maps::MapPackage> kept() {
    const fs::path place = work_.path("keep");
    (void)package("keep", place, keep_options(options_.build));
    return maps::MapPackage::open(place);
  }

  HeldBackAnswers answers_in(const std::string& name, const maps::MapPackage& in,
                             const std::vector<HeldBackDrive>& drives,
                             const Eigen::Isometry3d& T_in_map) {
    return answers_from(part(name, [&] {
      return text_of(ask_for(drives, in, T_in_map, options_.build.threads, under(name), cancel_));
    }));
  }

  void ask(const Maps& all) {
    const std::vector<HeldBackDrive> drives = held_back_drives(options_, *all.of_drives);
    report_.answers = answers_in("localize map", *all.map, drives, Eigen::Isometry3d::Identity());
    report_.keep_answers =
        answers_in("localize keep", *all.keep, drives, T_to_from(*all.keep, *all.of_drives));
    GateFigures& figures = report_.figures;
    figures.queries = report_.answers.queries;
    figures.found = report_.answers.found;
    figures.found_in_keep = report_.keep_answers.found;
    if (!options_.previous) return;
    const auto previous = maps::MapPackage::open(*options_.previous);
    report_.previous_digest = previous->digest();
    report_.previous_answers =
        answers_in("localize previous", *previous, drives, T_previous_map(*all.map));
    figures.previous = GateFigures::Previous{};
    figures.previous->ok = report_.previous_answers->ok;
    figures.previous->new_lost =
        newly_lost(report_.previous_answers->status, report_.answers.status);
  }

  void compare(const Maps& all) {
    const TileChoice tiles = judged(all);
    const maps::MapPackage& map = *all.map;
    const StaticLoss loss = loss_from(part("compare keep", [&] {
      return text_of(static_loss(*all.keep, map, T_to_from(*all.of_drives, *all.keep),
                                 under("compare keep"), cancel_, tiles));
    }));
    report_.static_points = loss.points;
    report_.static_points_lost = loss.lost;
    report_.figures.static_loss = loss.rate();
    if (!options_.previous) return;
    const GroundCoverage coverage = coverage_from(part("compare previous", [&] {
      const auto previous = maps::MapPackage::open(*options_.previous);
      return text_of(
          ground_coverage(*previous, map, T_previous_map(map).inverse(), cancel_, tiles));
    }));
    report_.figures.previous->driven_coverage = coverage.driven;
    report_.figures.previous->ground_coverage = coverage.near_path;
    const ConsistencyChange change = change_from(part("compare consistency", [&] {
      const auto previous = maps::MapPackage::open(*options_.previous);
      return text_of(consistency_change(*previous, map, T_previous_map(map).inverse(),
                                        options_.build.threads, under("compare consistency"),
                                        cancel_, tiles));
    }));
    report_.figures.previous->consistency_before = change.previous;
    report_.figures.previous->consistency_now = change.map;
  }

  void decide_gate() {
    report_.verdict = decide(report_.figures, options_.limits);
    if (!options_.held_back)
      report_.warnings.emplace_back(
          "judged by scans of the drives that the map is made from: these favour a map that keeps "
          "the cars that stood there");
  }

  void publish(const fs::path& place) {
    if (place == options_.map) return;
    if (cancel_) throw Cancelled();
    // Before the rename, so that a kill behind it is told from a path that was there before.
    work_.remember("done", report_.digest);
    if (std::rename(place.c_str(), options_.map.c_str()) != 0)
      throw maps::StorageError(options_.map.string(), std::strerror(errno));
  }

  /// Takes points of the new map to the previous one's frame, to which it is registered.
  [[nodiscard]] static Eigen::Isometry3d T_previous_map(const maps::MapPackage& map) {
    return map.manifest().registration.value().T_previous_map;
  }

  const RebuildOptions& options_;
  const ProgressCallback& progress_;
  const CancelFlag& cancel_;
  const CleanerFactory& make_cleaner_;
  const PackageMaker& make_package_;
  RebuildWork work_;
  RebuildResult report_;
};

}  // namespace

RebuildResult rebuild_map(const RebuildOptions& given, const ProgressCallback& progress,
                          const CancelFlag& cancel, const CleanerFactory& make_cleaner,
                          const PackageMaker& make_package) {
  require_usable(given);
  const RebuildOptions options = completed(given);
  require_comparable(options);
  return Rebuild(options, progress, cancel, make_cleaner, make_package).run();
}

MapBuildResult do_rebuild_unit(const RebuildOptions& given, std::string_view part,
                               const BuildUnit& unit, std::size_t units,
                               const ProgressCallback& progress, const CancelFlag& cancel) {
  require_usable(given);
  if (part != "map" && part != "keep")
    throw std::invalid_argument(
        fmt::format("unit of a rebuild (--unit): found '{}/{}', expected map/{} or keep/{}", part,
                    name_of(unit), name_of(unit), name_of(unit)));
  const RebuildOptions options = completed(given);
  return do_unit(options.drives, options.work / part,
                 part == "keep" ? keep_options(options.build) : options.build, unit, units,
                 progress, cancel);
}

std::vector<StageShare> rebuild_stages(const RebuildOptions& options) {
  std::vector<StageShare> stages;
  const auto add = [&](const std::string& part, double share,
                       const std::vector<StageShare>& of_part) {
    for (const StageShare& each : of_part)
      stages.push_back({part + ": " + each.stage, share * each.share});
  };
  // Of a drive of 1 km on two cores; the second build takes the first pass over.
  const bool registers = options.previous || options.build.register_to;
  add("map", 0.70, build_stages(registers));
  std::vector<StageShare> second = build_stages(registers);
  std::erase_if(second, [](const StageShare& each) {
    constexpr std::array kTakenOver{"odometry", "describe places", "check loops", "pose graph",
                                    "survey"};
    return std::ranges::find(kTakenOver, each.stage) != kTakenOver.end();
  });
  for (StageShare& each : second) {
    if (each.stage == "resume") each.share = 0.10;
  }
  if (options.patch) add("patch", 0.05, {{"seams", 0.3}, {"tiles", 0.7}});
  add("keep", 0.50, second);
  add("localize map", 0.06, {{"localize", 1.0}});
  add("localize keep", 0.06, {{"localize", 1.0}});
  if (options.previous) add("localize previous", 0.06, {{"localize", 1.0}});
  add("compare keep", 0.03, {{"compare", 1.0}});
  if (options.previous) add("compare consistency", 0.02, {{"compare", 1.0}});
  return stages;
}

}  // namespace stillmap::mapping

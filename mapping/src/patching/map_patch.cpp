#include <stillmap/mapping/map_patch.hpp>

#include "core/ordered_pipeline.hpp"
#include "core/top_view.hpp"
#include "patching/seam.hpp"
#include "patching/tile_merge.hpp"

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_difference.hpp>
#include <stillmap/maps/map_graph.hpp>
#include <stillmap/maps/package_files.hpp>
#include <stillmap/maps/pose_disagreement.hpp>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <bitset>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

namespace stillmap::mapping {
namespace {

namespace fs = std::filesystem;
using maps::MapPackage;
using maps::TileEvidence;
using maps::TileId;

constexpr const char* kSourcesName = "sources.sha256";
constexpr const char* kPreviewName = "preview.png";
constexpr std::size_t kColumns = std::size_t{TileEvidence::kSide} * TileEvidence::kSide;
using Columns = std::bitset<kColumns>;

std::size_t column_of(const maps::MapPoint& point) {
  const auto along = [](float value) {
    return static_cast<std::size_t>(std::clamp(value, 0.0F, TileEvidence::kSide - 1.0F));
  };
  return along(point.x) * TileEvidence::kSide + along(point.y);
}

Columns seen_columns(const TileEvidence& evidence) {
  Columns columns;
  for (const TileEvidence::OfDrive& each : evidence.drives) {
    const TileEvidence::Cubes seen = each.free | each.hit;
    for (std::size_t cube = 0; cube < TileEvidence::kCubes; ++cube)
      if (seen[cube]) columns.set(cube / TileEvidence::kLayers);
  }
  return columns;
}

/// What the scans, objects and drives of a map begin with in the patched one.
struct FirstNumbers {
  std::uint32_t scan = 0, object = 0, drive = 0;
};

/// A package whose tiles are read with the numbers of the patched map.
class Side {
 public:
  Side(const MapPackage& package, FirstNumbers first) : package_(package), first_(first) {}

  [[nodiscard]] const MapPackage& package() const { return package_; }
  [[nodiscard]] std::vector<maps::MapPoint> points(TileId id, const Eigen::Vector3d& corner) const {
    return package_.tile(id).points_from(corner);
  }
  [[nodiscard]] TileOfMap tile(TileId id) const {
    TileOfMap tile{points(id, maps::corner_of(id)), package_.history(id), package_.evidence(id)};
    for (maps::PointHistory& each : tile.history) {
      each.first_scan += first_.scan;
      each.last_scan += first_.scan;
      if (each.object > 0) each.object += first_.object;
    }
    for (TileEvidence::OfDrive& each : tile.evidence.drives) each.drive += first_.drive;
    return tile;
  }

 private:
  const MapPackage& package_;
  FirstNumbers first_;
};

FirstNumbers behind(const std::vector<maps::MapManifest::DriveCounts>& drives) {
  FirstNumbers first{0, 0, static_cast<std::uint32_t>(drives.size())};
  for (const auto& each : drives) {
    first.scan += each.scans;
    first.object += each.objects;
  }
  return first;
}

[[noreturn]] void refuse(const MapPackage& map, const std::string& found,
                         const std::string& expected) {
  throw maps::InputError(map.folder().string(), found, expected);
}

/// Maps that can be one.
void require_alike(const MapPackage& previous, const MapPackage& drive) {
  const maps::MapManifest &before = previous.manifest(), &now = drive.manifest();
  if (before.schema < 2 || now.schema < 2)
    refuse(before.schema < 2 ? previous : drive, "a package of schema 1",
           "schema 2: convert it with `stillmap store migrate`, or build the map again");
  if (previous.drive_counts().empty())
    refuse(previous, "a map that no drive made",
           "one with trajectories: make the new version without --patch");
  if (before.voxel_size_m != now.voxel_size_m)
    refuse(drive, fmt::format("voxels of {} m", now.voxel_size_m),
           fmt::format("{} m, as {}: give --voxel {}", before.voxel_size_m,
                       previous.folder().string(), before.voxel_size_m));
  if (!now.registration || now.registration->previous_digest != previous.digest() ||
      now.origin != before.origin)
    refuse(drive, "a map in a frame of its own",
           "one that is registered to " + previous.folder().string() +
               ": build it with --register-to");
}

class Patch {
 public:
  Patch(const MapPackage& previous, const MapPackage& drive, const PatchOptions& options,
        const ProgressCallback& progress, const CancelFlag& cancel)
      : counts_before_(previous.drive_counts()),
        before_(previous, {}),
        now_(drive, behind(counts_before_)),
        options_(options),
        progress_(progress),
        cancel_(cancel),
        tolerance_m_(maps::MapDifference::usual_tolerance_m(previous, drive)),
        ids_(tiles_to_patch(previous, drive, options)),
        in_order_(ids_.begin(), ids_.end()),
        picture_(TopView::of_tiles(all_tiles())) {
    if (std::none_of(ids_.begin(), ids_.end(), [&](TileId id) { return previous.has_tile(id); }))
      refuse(drive, "no tile of the map that the drives saw enough of",
             fmt::format("at least one of which they saw {:g} %: give longer drives",
                         100 * options.least_seen));
  }

  PatchResult write(const fs::path& target) {
    require_seams();
    maps::MapPackageWriter writer(target);
    std::vector<maps::MapManifest::DriveCounts> drives = counts_before_;
    const auto added = now_.package().drive_counts();
    drives.insert(drives.end(), added.begin(), added.end());
    writer.set_drives(drives);
    writer.take_over(before_.package(), ids_);
    for (std::size_t i = 0; i < added.size(); ++i) take_drive(writer, i, added[i].scans);
    draw_kept_tiles();
    write_tiles(writer);
    write_graph(writer.folder());
    write_sources(writer.folder());
    picture_.write_png(writer.folder() / kPreviewName);
    result_.digest = writer.publish(manifest(), build_json());
    measure(target);
    return result_;
  }

 private:
  [[nodiscard]] std::vector<TileId> all_tiles() const {
    std::set<TileId> all = ids_;
    for (const maps::TileEntry& tile : before_.package().tiles()) all.insert(tile.id);
    return {all.begin(), all.end()};
  }

  void draw_kept_tiles() {
    for (const TileId id : all_tiles()) {
      if (ids_.contains(id)) continue;
      if (cancel_) throw Cancelled();
      const maps::MapTile tile = before_.package().tile(id);
      for (const maps::MapPoint& p : tile) picture_.add_point(tile.from_origin(p));
    }
  }

  void tell(const char* stage, std::size_t done, std::size_t total) const {
    if (progress_) progress_(stage, done, total);
  }

  /// The surfaces of both are compared before anything is written.
  void require_seams() {
    std::vector<SeamFit> fits;
    std::size_t done = 0;
    process_in_order(
        in_order_.size(), options_.threads, [&](std::size_t i) { return fits_in(in_order_[i]); },
        [&](const std::vector<SeamFit>& found) {
          fits.insert(fits.end(), found.begin(), found.end());
          tell("seams", ++done, in_order_.size());
        },
        cancel_);
    std::ranges::sort(fits, {}, [](const SeamFit& each) { return each.middle.x(); });
    result_.seams = fits.size();
    std::size_t broken = 0;
    Eigen::Vector3d worst_off_m = Eigen::Vector3d::Zero();
    for (const SeamFit& place : fits) {
      const Eigen::Vector3d off_m = shared_shift_m(place, fits);
      if (off_m.norm() > options_.most_seam_m) ++broken;
      if (!(off_m.norm() > result_.worst_seam_m)) continue;
      result_.worst_seam_m = off_m.norm();
      worst_off_m = off_m;
      result_.worst_seam_at_map = place.middle;
    }
    if (broken == 0) return;
    const Eigen::Vector3d& at = result_.worst_seam_at_map;
    refuse(before_.package(),
           fmt::format("ground and walls {:.3f} m from those of the new drives at {:.1f} {:.1f} "
                       "{:.1f} ({:+.3f} {:+.3f} {:+.3f} m), in {} of {} places",
                       result_.worst_seam_m, at.x(), at.y(), at.z(), worst_off_m.x(),
                       worst_off_m.y(), worst_off_m.z(), broken, fits.size()),
           fmt::format(
               "within {:g} m: look there (`stillmap serve MAP`), leave out scans with bad poses "
               "(--select), or make the new version without --patch",
               options_.most_seam_m));
  }
  /// In the map frame.
  [[nodiscard]] std::vector<SeamFit> fits_in(TileId id) const {
    std::vector<SeamFit> fits;
    if (!before_.package().has_tile(id)) return fits;
    const TileOfMap before = before_.tile(id), now = now_.tile(id);
    const Eigen::Vector3d corner = before_.package().manifest().origin + maps::corner_of(id);
    for (int quarter = 0; quarter < 4; ++quarter) {
      auto fit = seam_between(before, now, quarter);
      if (!fit) continue;
      fit->middle += corner;
      fits.push_back(*fit);
    }
    return fits;
  }

  /// Positions of the new drives' points in a tile and around it, where they come into the map.
  [[nodiscard]] NearPoints near_now(TileId id) const {
    const auto reach = static_cast<float>(tolerance_m_);
    const auto side = static_cast<float>(maps::kTileSizeM);
    const auto is_near = [&](float value) { return value >= -reach && value <= side + reach; };
    std::vector<Eigen::Vector3f> measured, others;
    for (int step = 0; step < 9; ++step) {
      const TileId near{0, id.x + step % 3 - 1, id.y + step / 3 - 1};
      if (!ids_.contains(near)) continue;
      for (const maps::MapPoint& point : now_.points(near, maps::corner_of(id)))
        if (is_near(point.x) && is_near(point.y))
          (maps::is_measured(point.kind) ? measured : others)
              .emplace_back(point.x, point.y, point.z);
    }
    return {{std::move(measured), tolerance_m_}, {std::move(others), tolerance_m_}};
  }

  void write_tiles(maps::MapPackageWriter& writer) {
    std::size_t done = 0;
    process_in_order(
        in_order_.size(), options_.threads,
        [&](std::size_t i) {
          const TileId id = in_order_[i];
          return merged(before_.tile(id), now_.tile(id), near_now(id), tolerance_m_);
        },
        [&](MergedTile&& merged) {
          const TileId id = in_order_[done];
          result_.points_kept += merged.counts.kept;
          result_.points_replaced += merged.counts.replaced;
          result_.points_gone += merged.counts.gone;
          result_.points_added += merged.counts.added;
          if (merged.tile.history.size() != merged.tile.points.size()) {
            // One side has none, and without histories nothing tells whose object a point is of.
            merged.tile.history.clear();
            for (maps::MapPoint& point : merged.tile.points) point.object = 0;
          }
          const maps::MapTile tile(before_.package().manifest().origin, maps::corner_of(id),
                                   std::move(merged.tile.points));
          for (const maps::MapPoint& p : tile) picture_.add_point(tile.from_origin(p));
          if (!tile.empty()) writer.add_tile(id, tile, merged.tile.history, merged.tile.evidence);
          result_.tiles_new += tile.empty() ? 0 : 1;
          tell("tiles", ++done, in_order_.size());
        },
        cancel_);
  }

  void take_drive(maps::MapPackageWriter& writer, std::size_t drive, std::size_t scans) const {
    const std::size_t as = counts_before_.size() + drive;
    writer.take_drive(now_.package(), drive, as);
    // All drives have them, or none.
    const bool has = before_.package().manifest().files.contains(maps::disagreement_path(0));
    const fs::path file = writer.folder() / maps::disagreement_path(as);
    if (!has) fs::remove(file);
    if (has && !fs::exists(file))
      maps::write_pose_disagreements(writer.folder(), std::vector<maps::PoseDisagreement>(scans),
                                     as);
  }

  void write_graph(const fs::path& folder) const {
    const auto before = maps::read_map_graph(before_.package());
    const auto now = maps::read_map_graph(now_.package());
    if (!before && !now) return;
    const auto or_derived = [](const std::optional<maps::MapGraph>& graph, const MapPackage& map) {
      return graph ? *graph : maps::MapGraph{maps::derived_key_frames(map.trajectories()), {}};
    };
    maps::MapGraph all = or_derived(before, before_.package());
    const std::size_t first = behind(counts_before_).scan;
    const maps::MapGraph added = or_derived(now, now_.package());
    for (const std::size_t pose : added.key_frames) all.key_frames.push_back(first + pose);
    for (const maps::MapGraph::Loop& loop : added.loops)
      all.loops.push_back({first + loop.from, first + loop.to, loop.weight});
    maps::write_map_graph(folder, all);
  }

  void write_sources(const fs::path& folder) const {
    std::string text;
    for (const MapPackage* map : {&before_.package(), &now_.package()}) {
      if (!map->manifest().files.contains(kSourcesName)) return;
      text += maps::read_text(map->folder() / kSourcesName);
    }
    std::ofstream out(folder / kSourcesName, std::ios::binary);
    out << text << std::flush;
    if (!out) throw maps::StorageError((folder / kSourcesName).string(), "cannot be written");
  }

  [[nodiscard]] maps::MapManifest manifest() const {
    const maps::MapManifest &before = before_.package().manifest(),
                            &now = now_.package().manifest();
    maps::MapManifest all = before;
    all.registration = now.registration;
    all.software_version = now.software_version;
    all.options = now.options;
    all.options["patch"] = "on";
    for (const auto& [name, count] : now.counts) {
      // Of poses there are medians and largest values.
      std::uint64_t& sum = all.counts[name];
      sum = name.starts_with("poses_") ? std::max(sum, count) : sum + count;
    }
    all.counts["static"] =
        before.extent.points + result_.points_added - result_.points_replaced - result_.points_gone;
    const std::size_t drives = std::max<std::size_t>(1, counts_before_.size());
    for (const auto& [name, text] : now.sources) all.sources[source_name(name, drives)] = text;
    return all;
  }
  /// `drive`, `drive_2` ... are numbered on.
  static std::string source_name(const std::string& name, std::size_t drives) {
    if (name == "drive") return fmt::format("drive_{}", drives + 1);
    std::size_t number = 0;
    if (std::sscanf(name.c_str(), "drive_%zu", &number) != 1) return name;
    return fmt::format("drive_{}", drives + number);
  }

  /// That of the new drives' map, with what the patch did.
  [[nodiscard]] std::string build_json() const {
    const fs::path file = now_.package().folder() / maps::kBuildName;
    auto json = nlohmann::json::parse(maps::read_text(file), nullptr, false);
    if (!json.is_object()) json = {{"warnings", nlohmann::json::array()}};
    json.erase("digest");
    // What only the finished package tells is not in it.
    json["patch"] = nlohmann::json::parse(to_json(result_));
    for (const char* key :
         {"digest", "tiles_kept", "regions_new", "regions_kept", "bytes_new", "bytes"})
      json["patch"].erase(key);
    return json.dump(2) + "\n";
  }

  /// What is new in the package.
  void measure(const fs::path& target) {
    const auto package = MapPackage::open(target);
    const auto& known = before_.package().manifest().files;
    for (const auto& [path, file] : package->manifest().files) {
      result_.bytes += file.bytes;
      const auto found = known.find(path);
      const bool same = found != known.end() && found->second.sha256 == file.sha256;
      if (!same) result_.bytes_new += file.bytes;
      if (path.starts_with("regions/")) ++(same ? result_.regions_kept : result_.regions_new);
    }
    result_.tiles_kept = package->manifest().extent.tiles - result_.tiles_new;
  }

  const std::vector<maps::MapManifest::DriveCounts> counts_before_;
  Side before_, now_;
  const PatchOptions& options_;
  const ProgressCallback& progress_;
  const CancelFlag& cancel_;
  double tolerance_m_;
  std::set<TileId> ids_;
  std::vector<TileId> in_order_;
  TopView picture_;
  PatchResult result_;
};

}  // namespace

std::vector<std::string> PatchOptions::violations() const {
  std::vector<std::string> broken;
  const auto check = [&](bool holds, const std::string& text) {
    if (!holds) broken.push_back(text);
  };
  check(most_seam_m >= 0.005 && most_seam_m <= 0.2,
        fmt::format("most_seam_m: {}, expected in [0.005, 0.2]", most_seam_m));
  check(least_seen > 0.0 && least_seen <= 1.0,
        fmt::format("least_seen: {}, expected in (0, 1]", least_seen));
  check(threads >= 0 && threads <= 256, fmt::format("threads: {}, expected in [0, 256]", threads));
  return broken;
}

std::set<TileId> tiles_to_patch(const MapPackage& previous, const MapPackage& drive,
                                const PatchOptions& options) {
  std::set<TileId> ids;
  for (const maps::TileEntry& tile : drive.tiles()) {
    Columns known;
    for (const maps::MapPoint& point : Side(previous, {}).points(tile.id, maps::corner_of(tile.id)))
      known.set(column_of(point));
    const Columns seen = seen_columns(drive.evidence(tile.id));
    const auto count = [](const Columns& columns) { return static_cast<double>(columns.count()); };
    if (known.none() || count(seen & known) >= options.least_seen * count(known))
      ids.insert(tile.id);
  }
  return ids;
}

PatchResult patch_map(const MapPackage& previous, const MapPackage& drive, const fs::path& target,
                      const PatchOptions& options, const ProgressCallback& progress,
                      const CancelFlag& cancel) {
  if (const auto broken = options.violations(); !broken.empty())
    throw std::invalid_argument("patch options: " + broken.front());
  require_alike(previous, drive);
  return Patch(previous, drive, options, progress, cancel).write(target);
}

}  // namespace stillmap::mapping

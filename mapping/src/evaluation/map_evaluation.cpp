#include "core/point_cells.hpp"
#include "core/share_of.hpp"
#include "core/top_view.hpp"
#include "evaluation/labels/before_and_after.hpp"
#include "evaluation/labels/labelled_scans.hpp"
#include "evaluation/labels/map_voxels.hpp"
#include "evaluation/labels/thinned_map.hpp"
#include "pipeline/scan_work.hpp"
#include "trajectory/drive_of_map.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <stillmap/mapping/map_evaluation.hpp>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

namespace stillmap::mapping {
namespace {

constexpr double kMinHeightM = 0.3;
constexpr double kNearM = 0.1;
constexpr double kLabelMarginM = 0.1;
constexpr double kHalfFieldOfViewRad = 40.0 * std::numbers::pi / 180.0;
constexpr Colour kLabelColour{255, 80, 80};

const std::string& option_of(const maps::MapPackage& map, const std::string& name) {
  const auto found = map.manifest().options.find(name);
  if (found == map.manifest().options.end()) {
    throw maps::InputError((map.folder() / "manifest.json").string(), "no option '" + name + "'",
                           "a map made by `stillmap build`");
  }
  return found->second;
}

/// Measured points, from the map's origin [m].
std::vector<Eigen::Vector3f> measured_of(const maps::MapPackage& map) {
  std::vector<Eigen::Vector3f> points;
  for_each_point(map, [&](const Eigen::Vector3f& p, maps::PointKind kind) {
    if (maps::is_measured(kind)) points.push_back(p);
  });
  return points;
}

/// The map's only path.
maps::Trajectory path_of(const maps::MapPackage& map) {
  std::vector<maps::Trajectory> paths = map.trajectories();
  if (paths.size() != 1)
    throw maps::InputError(map.folder().string(), fmt::format("a map of {} drives", paths.size()),
                           "a map of one drive: build it of the labelled drive alone");
  return std::move(paths.front());
}

/// Scans of the drive that the map was made of.
std::vector<std::size_t> mapped_scans(const maps::MapPackage& map, const maps::Trajectory& path,
                                      const maps::Drive& drive) {
  std::vector<std::size_t> indices =
      maps::Selection::parse(option_of(map, "select")).indices(drive.size());
  const std::vector<maps::StampedPose>& poses = path.poses();
  if (poses.size() != indices.size()) {
    throw maps::InputError(drive.contents().root.string(),
                           fmt::format("{} scans for the map's selection", indices.size()),
                           fmt::format("the map's {}", poses.size()));
  }
  for (std::size_t i = 0; i < indices.size(); ++i) {
    if (drive.stamp_ns(indices[i]) == poses[i].stamp_ns) continue;
    throw maps::InputError(
        drive.contents().root.string(),
        fmt::format("scan {} at {} ns", indices[i], drive.stamp_ns(indices[i])),
        fmt::format("the map's {} ns: the drive that it was made of", poses[i].stamp_ns));
  }
  return indices;
}

std::vector<std::size_t> labelled_scans(std::vector<std::size_t> indices,
                                        const maps::BoxSequence& labels,
                                        const std::filesystem::path& file) {
  std::erase_if(indices, [&](std::size_t i) { return !labels.by_scan.contains(i); });
  if (indices.empty())
    throw maps::InputError(file.string(), "no label of a scan in the map",
                           "at least one: give labels of scans that the map was made of");
  return indices;
}

bool any_holds(const std::vector<maps::Box>& boxes, const Eigen::Vector3d& p, double margin_m) {
  return std::any_of(boxes.begin(), boxes.end(),
                     [&](const maps::Box& box) { return box.contains(p, margin_m); });
}

/// One drive against one map.
class Judge {
 public:
  Judge(const maps::MapPackage& map, const maps::Drive& drive, maps::BoxSequence labels)
      : map_(map),
        drive_(drive),
        labels_(std::move(labels)),
        voxels_(map),
        points_(measured_of(map), kNearM),
        ground_(make_ground_segmenter()),
        range_m_{number_option(map, "min_range_m"), number_option(map, "max_range_m")} {}

  /// @param ordinal  of the scan in the map.
  void scan(std::size_t index, std::size_t ordinal, MapEvaluation& result) const {
    const maps::Scan scan = read(index);
    const maps::ScanFates fates = map_.fates(ordinal);
    if (fates.size() != scan.points_in_file)
      throw maps::InputError(map_.folder().string(),
                             fmt::format("fates of {} points of scan {}", fates.size(), index),
                             fmt::format("{}", scan.points_in_file));
    const GroundResult ground = ground_->segment(scan.cloud);
    for (std::size_t i = 0; i < scan.cloud.size(); ++i) {
      const maps::PointFate fate = fates.fates[scan.cloud.file_index(i)];
      const bool stays = fate == maps::PointFate::kKept || fate == maps::PointFate::kGround;
      point(index, scan.cloud.positions[i].cast<double>(), ground, stays, result);
    }
    ++result.scans;
  }

  /// @param mapped    scans that the map was made of.
  /// @param labelled  those of them with labels.
  void draw(const std::filesystem::path& folder, const std::vector<std::size_t>& mapped,
            const std::vector<std::size_t>& labelled) const {
    TopView before = empty_view(map_);
    TopView after = before;
    const Eigen::Vector3d& origin = map_.manifest().origin;
    for (const std::size_t index : mapped) {
      for (const Eigen::Vector3f& p : read(index).cloud.positions)
        before.add_point(drive_.T_map_lidar(index) * p.cast<double>() - origin);
    }
    for_each_point(map_, [&](const Eigen::Vector3f& p, maps::PointKind) {
      after.add_point(p.cast<double>());
    });
    for (const std::size_t index : labelled) {
      Eigen::Isometry3d T_picture_lidar = drive_.T_map_lidar(index);
      T_picture_lidar.translation() -= origin;
      for (const maps::Box& box : labels_.by_scan.at(index)) {
        before.add_box(box, T_picture_lidar, kLabelColour);
        after.add_box(box, T_picture_lidar, kLabelColour);
      }
    }
    std::filesystem::create_directories(folder);
    before.write_png(folder / "before.png");
    after.write_png(folder / "after.png");
  }

 private:
  [[nodiscard]] maps::Scan read(std::size_t index) const {
    std::map<std::string, std::uint64_t> counts;
    return read_deskewed(drive_, index, range_m_, counts);
  }

  void point(std::size_t scan, const Eigen::Vector3d& p, const GroundResult& ground, bool stays,
             MapEvaluation& result) const {
    const std::vector<maps::Box>& labels = labels_.by_scan.at(scan);
    const Eigen::Vector3d p_map = drive_.T_map_lidar(scan) * p;
    if (!any_holds(labels, p, kLabelMarginM)) {
      const bool changed = !voxels_.hold(p_map);
      const bool in_view = std::abs(std::atan2(p.y(), p.x())) < kHalfFieldOfViewRad;
      ++result.outside_points;
      result.outside_changed += changed ? 1 : 0;
      result.fov_points += in_view ? 1 : 0;
      result.fov_changed += in_view && changed ? 1 : 0;
      return;
    }
    if (!any_holds(labels, p, 0.0)) return;
    const auto below = ground.surface->at(p.x(), p.y());
    if (!below || p.z() - below->z <= kMinHeightM) return;
    ++result.box_points_before;
    result.box_points_after += stays ? 1 : 0;
    result.box_points_in_map +=
        points_.any_within((p_map - map_.manifest().origin).cast<float>(), kNearM) ? 1 : 0;
  }

  const maps::MapPackage& map_;
  const maps::Drive& drive_;
  maps::BoxSequence labels_;
  MapVoxels voxels_;
  PointCells points_;
  std::unique_ptr<GroundSegmenter> ground_;
  std::array<double, 2> range_m_;
};

}  // namespace

MapEvaluation evaluate_map(const maps::MapPackage& map, const maps::Drive& drive,
                           const MapEvaluationOptions& options, const ProgressCallback& progress,
                           const CancelFlag& cancel) {
  const auto began = std::chrono::steady_clock::now();
  if (!drive.has_poses())
    throw maps::InputError(drive.contents().root.string(), "a drive without poses",
                           "poses: give --poses FILE");
  drive.require_own_numbers(options.boxes_file);
  maps::BoxSequence labels = maps::read_boxes(options.boxes_file, drive.size());
  const maps::Trajectory path = path_of(map);
  const std::vector<std::size_t> mapped = mapped_scans(map, path, drive);
  const std::vector<std::size_t> labelled = labelled_scans(mapped, labels, options.boxes_file);
  const maps::Drive posed = on_path(drive, path);
  const Judge judge(map, posed, std::move(labels));
  MapEvaluation result;
  for (const std::size_t index : labelled) {
    if (cancel) throw Cancelled();
    const auto ordinal = std::lower_bound(mapped.begin(), mapped.end(), index) - mapped.begin();
    judge.scan(index, static_cast<std::size_t>(ordinal), result);
    if (progress) progress("scans", result.scans, labelled.size());
  }
  if (options.pictures_folder) judge.draw(*options.pictures_folder, mapped, labelled);
  result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  return result;
}

std::string to_json(const MapEvaluation& evaluation) {
  const MapEvaluation& e = evaluation;
  return nlohmann::json{
      {"scans", e.scans},
      {"seconds", e.seconds},
      {"box_points",
       {{"before", e.box_points_before},
        {"after", e.box_points_after},
        {"removed_share", 1.0 - share_of(e.box_points_after, e.box_points_before)},
        {"in_map", e.box_points_in_map},
        {"in_map_removed_share", 1.0 - share_of(e.box_points_in_map, e.box_points_before)}}},
      {"outside",
       {{"points", e.outside_points},
        {"changed", e.outside_changed},
        {"changed_share", share_of(e.outside_changed, e.outside_points)},
        {"fov_points", e.fov_points},
        {"fov_changed", e.fov_changed},
        {"fov_changed_share", share_of(e.fov_changed, e.fov_points)}}}}
      .dump(2);
}

}  // namespace stillmap::mapping

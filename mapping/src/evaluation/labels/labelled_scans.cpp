#include "evaluation/labels/labelled_scans.hpp"

#include "drives/drive_set.hpp"
#include "evaluation/published_metrics.hpp"
#include "trajectory/drive_of_map.hpp"

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <charconv>
#include <limits>
#include <string>
#include <string_view>
#include <system_error>

namespace stillmap::mapping {
namespace {

std::string manifest_of(const maps::MapPackage& map) {
  return (map.folder() / "manifest.json").string();
}

InMap state_of(maps::PointFate fate, bool voxel_holds) {
  switch (fate) {
    case maps::PointFate::kKept:
    case maps::PointFate::kGround:
      return voxel_holds ? InMap::kMeasured : InMap::kGone;
    case maps::PointFate::kProjected:
      return InMap::kProjected;
    case maps::PointFate::kDeleted:
    case maps::PointFate::kDropped:
      break;
  }
  return InMap::kGone;
}

}  // namespace

double number_option(const maps::MapPackage& map, const std::string& name) {
  const auto& options = map.manifest().options;
  const auto found = options.find(name);
  if (found == options.end())
    throw maps::InputError(manifest_of(map), "no option '" + name + "'",
                           "a map made by `stillmap build`");
  const std::string& text = found->second;
  double number = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size())
    throw maps::InputError(manifest_of(map), "option " + name + " '" + text + "'", "a number");
  return number;
}

LabelledScans::LabelledScans(const maps::MapPackage& map, const maps::Drive& drive,
                             DriveTruth& truth)
    : map_(map),
      drive_(drive),
      truth_(truth),
      voxels_(map),
      range_m_{number_option(map, "min_range_m"), number_option(map, "max_range_m")} {
  const auto& files = drive.contents().label_files;
  if (std::all_of(files.begin(), files.end(), [](const auto& file) { return file.empty(); })) {
    throw maps::InputError(drive.contents().root.string(), "a drive without labels",
                           "SemanticKITTI labels of its points, or --boxes FILE");
  }
  scans_ = scans_in_map();
  in_map_ = !scans_.empty();
  if (!in_map_) scans_ = all_scans();
  if (!truth.has_surface()) collect_labelled_ground();
}

std::vector<LabelledScans::Entry> LabelledScans::scans_in_map() const {
  std::vector<Entry> entries;
  if (const auto found = find_in_map(map_, drive_)) {
    for (std::size_t i = 0; i < found->scans.size(); ++i)
      entries.push_back(
          {found->scans[i], found->first_ordinal + i, found->path.poses()[i].T_map_lidar});
  }
  return entries;
}

std::vector<LabelledScans::Entry> LabelledScans::all_scans() const {
  if (!drive_.has_poses()) {
    throw maps::InputError(drive_.contents().root.string(),
                           "a drive without poses that is not in the map",
                           "one that the map was made of, or poses in its frame");
  }
  std::vector<Entry> entries;
  for (std::size_t i = 0; i < drive_.size(); ++i) entries.push_back({i, 0, drive_.T_map_lidar(i)});
  return entries;
}

Eigen::Isometry3d LabelledScans::T_truth_map(std::size_t scan) const {
  const auto T_truth_lidar = truth_.T_truth_lidar(index(scan));
  return T_truth_lidar ? *T_truth_lidar * T_map_lidar(scan).inverse()
                       : Eigen::Isometry3d::Identity();
}

std::vector<std::uint32_t> LabelledScans::labels_of(const maps::Scan& scan) const {
  const std::filesystem::path& file = drive_.contents().label_files.at(scan.index);
  std::vector<std::uint32_t> labels(scan.points_in_file, 0);
  // A scan without labels is part of the map all the same.
  if (file.empty()) return labels;
  // Not Drive::read_labels, which reads the scan once more to count its points.
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  if (!in) throw maps::StorageError(file.string(), "cannot be opened");
  const auto bytes = static_cast<std::size_t>(in.tellg());
  if (bytes != labels.size() * sizeof(std::uint32_t)) {
    throw maps::InputError(
        file.string(), fmt::format("{} bytes", bytes),
        fmt::format("4 for each of the {} points of {}", labels.size(), scan.source));
  }
  in.seekg(0);
  if (!in.read(reinterpret_cast<char*>(labels.data()), static_cast<std::streamsize>(bytes)))
    throw maps::StorageError(file.string(), "cannot be read");
  return labels;
}

std::vector<maps::PointFate> LabelledScans::fates_of(const Entry& entry,
                                                     const maps::Scan& scan) const {
  if (!in_map_) return std::vector<maps::PointFate>(scan.points_in_file, maps::PointFate::kDeleted);
  std::vector<maps::PointFate> fates = map_.fates(entry.ordinal).fates;
  if (fates.size() != scan.points_in_file) {
    throw maps::InputError(
        map_.folder().string(),
        fmt::format("fates of {} points of scan {}", fates.size(), entry.ordinal),
        fmt::format("the {} points of {}", scan.points_in_file, scan.source));
  }
  return fates;
}

float LabelledScans::parked_height_m(ClassIndex index, const Eigen::Vector3d& p_truth) const {
  if (semantic_classes()[index].kind != ClassKind::kParked) return 0.0F;
  const auto ground = truth_.ground_height(p_truth.x(), p_truth.y());
  return ground ? static_cast<float>(p_truth.z() - *ground)
                : std::numeric_limits<float>::quiet_NaN();
}

LabelledScan LabelledScans::read(std::size_t scan, Depth depth) const {
  const Entry& entry = scans_.at(scan);
  std::map<std::string, std::uint64_t> counts;
  const maps::Scan raw = read_deskewed(drive_, entry.index, range_m_, counts);
  const std::vector<std::uint32_t> labels = labels_of(raw);
  const std::vector<maps::PointFate> fates = fates_of(entry, raw);
  const Eigen::Vector3d& origin = map_.manifest().origin;
  const Eigen::Isometry3d T_truth_lidar =
      truth_.T_truth_lidar(entry.index).value_or(entry.T_map_lidar);
  LabelledScan out;
  out.sensor = (entry.T_map_lidar.translation() - origin).cast<float>();
  for (std::size_t i = 0; i < raw.cloud.size(); ++i) {
    const std::size_t at = raw.cloud.file_index(i);
    if (fates[at] == maps::PointFate::kDropped) continue;
    const ClassIndex index = class_index(labels[at]);
    if (index == no_class()) {
      throw maps::InputError(drive_.contents().label_files.at(entry.index).string(),
                             fmt::format("class {}", labels[at] & 0xFFFFU),
                             "a class of SemanticKITTI");
    }
    const Eigen::Vector3f& p = raw.cloud.positions[i];
    const Eigen::Vector3d p_map = entry.T_map_lidar * p.cast<double>();
    out.positions.emplace_back((p_map - origin).cast<float>());
    out.classes.push_back(index);
    out.is_near.push_back(p.norm() < static_cast<float>(kTruthRangeM) ? 1 : 0);
    if (depth == Depth::kPositions) continue;
    out.in_map.push_back(in_map_ ? state_of(fates[at], voxels_.hold(p_map)) : InMap::kGone);
    out.is_ground.push_back(fates[at] == maps::PointFate::kGround ? 1 : 0);
    if (depth == Depth::kPlaces) continue;
    out.heights_m.push_back(parked_height_m(index, T_truth_lidar * p.cast<double>()));
  }
  out.dropped = raw.points_in_file - out.size();
  return out;
}

void LabelledScans::collect_labelled_ground() {
  for (const Entry& entry : scans_) {
    std::map<std::string, std::uint64_t> counts;
    const maps::Scan raw = read_deskewed(drive_, entry.index, range_m_, counts);
    const std::vector<std::uint32_t> labels = labels_of(raw);
    const Eigen::Isometry3d T_truth_lidar =
        truth_.T_truth_lidar(entry.index).value_or(entry.T_map_lidar);
    for (std::size_t i = 0; i < raw.cloud.size(); ++i) {
      const ClassIndex index = class_index(labels[raw.cloud.file_index(i)]);
      if (index != no_class() && ground_truth(index) == GroundTruth::kGround)
        truth_.labelled_ground().add(T_truth_lidar * raw.cloud.positions[i].cast<double>());
    }
  }
}

}  // namespace stillmap::mapping

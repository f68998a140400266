#include <stillmap/maps/error.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <algorithm>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "exports/exporters.hpp"
#include "exports/file_coordinates.hpp"
#include "rawlogs/rawlog_process.hpp"
#include "rawlogs/rawlog_record.hpp"

namespace stillmap::maps {
namespace {

/// Share of the work that is done when MRPT begins to write, which tells nothing more.
constexpr double kWriting = 0.61;

/// Drive and number of a pose.
using PoseNumber = std::pair<std::size_t, std::size_t>;

/// Each tile belongs to the pose that is nearest to its middle.
std::map<PoseNumber, std::vector<TileEntry>> keyframes_of(
    const ExportJob& job, const std::vector<Trajectory>& trajectories) {
  std::map<PoseNumber, std::vector<TileEntry>> keyframes;
  const std::vector<TileEntry> tiles = point_tiles(job.map);
  std::size_t done = 0;
  for (const TileEntry& tile : tiles) {
    job.tell({0.2, 0.3}, done++, tiles.size());
    const Eigen::Vector3d middle = job.map.manifest().bounds_of(tile).center();
    PoseNumber nearest;
    double least_m2 = std::numeric_limits<double>::infinity();
    for (std::size_t drive = 0; drive < trajectories.size(); ++drive) {
      const auto& poses = trajectories[drive].poses();
      for (std::size_t i = 0; i < poses.size(); ++i) {
        const double distance_m2 = (poses[i].T_map_lidar.translation() - middle).squaredNorm();
        if (distance_m2 < least_m2) {
          least_m2 = distance_m2;
          nearest = {drive, i};
        }
      }
    }
    keyframes[nearest].push_back(tile);
  }
  return keyframes;
}

std::vector<RawlogPoint> points_of(const ExportJob& job, const std::vector<TileEntry>& tiles,
                                   const FileCoordinates& coordinates,
                                   const Eigen::Isometry3d& T_lidar_file) {
  std::vector<RawlogPoint> points;
  for (const TileEntry& entry : tiles) {
    const MapTile tile = job.map.tile(entry.id);
    for (const MapPoint& point : tile) {
      if (!job.takes(point.kind)) continue;
      const Eigen::Vector3f p = (T_lidar_file * coordinates(tile, point)).cast<float>();
      points.push_back({p.x(), p.y(), p.z(), point.intensity, 0.0F});
    }
  }
  return points;
}

RawlogRecord record_of(const StampedPose& pose, const Eigen::Isometry3d& T_file_lidar,
                       std::size_t points) {
  if (points > std::numeric_limits<std::uint32_t>::max())
    throw std::length_error("more points around one pose than a keyframe holds");
  RawlogRecord record;
  record.kind = RawlogRecordKind::kKeyframe;
  record.stamp_ns = pose.stamp_ns;
  Eigen::Map<Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(record.pose.data()) =
      T_file_lidar.matrix().topRows<3>();
  record.points = static_cast<std::uint32_t>(points);
  return record;
}

}  // namespace

void export_simplemap(ExportJob& job) {
  const std::string name = job.map.folder().string();
  const std::filesystem::path program = rawlog_program();
  if (program.empty())
    throw InputError(name, "no stillmap-rawlog, which writes simplemaps",
                     "that program (built where MRPT's libmrpt-obs-dev and libmrpt-maps-dev are)");
  const std::vector<Trajectory> trajectories = job.map.trajectories();
  if (std::all_of(trajectories.begin(), trajectories.end(),
                  [](const Trajectory& each) { return each.poses().empty(); }))
    throw InputError(name, "no trajectory",
                     "a map that was built from a drive: choose another format");
  count_chosen(job);
  const FileCoordinates coordinates(job.map, job.frame);
  const auto keyframes = keyframes_of(job, trajectories);
  UnnamedFile records;
  std::uint64_t written = 0;
  std::size_t done = 0;
  for (const auto& [number, tiles] : keyframes) {
    const StampedPose& pose = trajectories[number.first].poses()[number.second];
    Eigen::Isometry3d T_file_lidar = pose.T_map_lidar;
    T_file_lidar.translation() -= job.result.origin;
    const std::vector<RawlogPoint> points =
        points_of(job, tiles, coordinates, T_file_lidar.inverse());
    if (!points.empty()) {
      const RawlogRecord record = record_of(pose, T_file_lidar, points.size());
      records.append(&record, sizeof record);
      records.append(points.data(), points.size() * sizeof(RawlogPoint));
      ++written;
    }
    job.tell({0.3, 0.6}, ++done, keyframes.size());
  }
  const RawlogRecord end;
  records.append(&end, sizeof end);
  job.result.counts["keyframes"] = written;
  const auto go_on = [&] { return !job.options.work.go_on || job.options.work.go_on(kWriting); };
  if (!write_simplemap(program, records, job.target, go_on)) throw WorkStopped();
}

}  // namespace stillmap::maps

#include "pipeline/graph_of_poses.hpp"

#include <algorithm>
#include <optional>

namespace stillmap::mapping {
namespace {

/// Numbers of poses by their scans.
class PoseNumbers {
 public:
  explicit PoseNumbers(const DriveSet& drives) : scans_(drives.drives().size()) {
    for (std::size_t pose = 0; pose < drives.size(); ++pose) {
      const DriveSet::Place place = drives.place(pose);
      scans_.at(place.drive).push_back({place.index, pose});
    }
  }

  /// Nothing of a drive that has no scan in the map.
  [[nodiscard]] std::optional<std::size_t> of(const DriveSet::Place& place) const {
    const std::vector<Scan>& scans = scans_.at(place.drive);
    if (scans.empty()) return std::nullopt;
    const auto after =
        std::lower_bound(scans.begin(), scans.end(), place.index,
                         [](const Scan& scan, std::size_t index) { return scan.index < index; });
    if (after == scans.end()) return scans.back().pose;
    if (after == scans.begin()) return after->pose;
    const auto before = after - 1;
    return after->index - place.index < place.index - before->index ? after->pose : before->pose;
  }

 private:
  struct Scan {
    std::size_t index = 0;
    std::size_t pose = 0;
  };
  /// By drive, ascending.
  std::vector<std::vector<Scan>> scans_;
};

}  // namespace

DriveGraph drive_graph_of(const TrajectoryEstimate& estimate) {
  DriveGraph graph;
  for (std::size_t drive = 0; drive < estimate.drives.size(); ++drive)
    for (const std::size_t scan : estimate.drives[drive].keyframes)
      graph.key_frames.push_back({.drive = drive, .index = scan});
  for (const EstimatedLoop& loop : estimate.loops)
    graph.loops.push_back({.from = {.drive = loop.from_drive, .index = loop.from_scan},
                           .to = {.drive = loop.to_drive, .index = loop.to_scan},
                           .weight = std::clamp(loop.weight, 0.0, 1.0)});
  return graph;
}

maps::MapGraph map_graph_of(const DriveSet& drives, const DriveGraph& graph) {
  const PoseNumbers numbers(drives);
  maps::MapGraph result;
  for (const DriveSet::Place& place : graph.key_frames)
    if (const auto pose = numbers.of(place)) result.key_frames.push_back(*pose);
  std::sort(result.key_frames.begin(), result.key_frames.end());
  const auto repeated = std::unique(result.key_frames.begin(), result.key_frames.end());
  result.key_frames.erase(repeated, result.key_frames.end());
  for (const DriveGraph::Loop& loop : graph.loops) {
    const auto from = numbers.of(loop.from);
    const auto to = numbers.of(loop.to);
    if (from && to) result.loops.push_back({.from = *from, .to = *to, .weight = loop.weight});
  }
  return result;
}

}  // namespace stillmap::mapping

#include "core/seconds_since.hpp"
#include "pipeline/build.hpp"
#include "pipeline/build_warnings.hpp"
#include "pipeline/manifest.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_graph.hpp>
#include <stillmap/maps/map_object.hpp>
#include <stillmap/maps/peak_memory.hpp>

#include <malloc.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::mapping {
namespace {

std::map<std::string, std::uint64_t> object_counts(const Build& build,
                                                   const std::vector<maps::MapObject>& objects) {
  std::map<std::string, std::uint64_t> counts{{"parked", 0}, {"moving", 0}};
  for (const maps::MapObject& object : objects) ++counts[std::string(name_of(object.motion))];
  counts["boxes"] = build.survey->box_count;
  for (const auto& [reason, count] : build.scan_work->dropped_boxes())
    counts["dropped: " + reason] = count;
  counts["edits_applied"] = build.objects.edits.applied;
  counts["edits_unmatched"] = build.objects.edits.unmatched.size();
  return counts;
}

void write_text(const std::filesystem::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary);
  out << text << std::flush;
  if (!out) throw maps::StorageError(file.string(), "cannot be written");
}

void write_sources(const Build& build, const std::vector<maps::MapObject>& objects) {
  maps::MapPackageWriter& writer = *build.task.writer;
  const std::vector<maps::Trajectory> trajectories = build.drives->trajectories();
  for (std::size_t i = 0; i < trajectories.size(); ++i) writer.write_trajectory(trajectories[i], i);
  writer.write_objects(objects);
  write_text(writer.folder() / "sources.sha256", build.survey->sources);
  if (build.posed.graph)
    maps::write_map_graph(writer.folder(), map_graph_of(*build.drives, *build.posed.graph));
  std::span<const maps::PoseDisagreement> left = build.disagreements;
  for (std::size_t i = 0; i < trajectories.size() && !left.empty(); ++i) {
    maps::write_pose_disagreements(writer.folder(), left.first(trajectories[i].size()), i);
    left = left.subspan(trajectories[i].size());
  }
}

}  // namespace

void write_package(Build& build) {
  MapBuildResult& result = build.result;
  const std::vector<maps::MapObject> objects =
      to_map_objects(*build.drives, build.objects.objects, build.placed->points_removed,
                     build.task.options.fusion);
  warn_of_near_points(build);
  result.objects = object_counts(build, objects);
  warn_of_unmatched_edits(build);
  write_sources(build, objects);
  // They hold files of the scratch folder open.
  build.placed.reset();
  build.survey.reset();
  // The library keeps what was freed, and packs are read now.
  ::malloc_trim(0);
  std::filesystem::remove_all(build.task.scratch);
  build.stop_if_cancelled();
  build.tell("publish", 0, 1);
  result.seconds = seconds_since(build.began);
  result.scans_per_second = static_cast<double>(result.scans) / std::max(result.seconds, 1e-9);
  result.peak_rss_mib = maps::peak_rss_mib();
  result.digest = build.task.writer->publish(manifest_of(build), to_json(result));
}

}  // namespace stillmap::mapping

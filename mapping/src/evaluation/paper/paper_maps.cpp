#include "evaluation/paper/paper_maps.hpp"

#include <stillmap/mapping/paper_evaluation.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

MapBuildOptions paper_build() {
  MapBuildOptions build;
  apply_paper_preset(build);
  return build;
}

/// No boxes are looked for, and scans are stacked as they are.
MapBuildOptions without_detector(const std::string& clean) {
  MapBuildOptions build = paper_build();
  build.projection.policy = MovablePolicy::kKeep;
  build.clean = clean;
  return build;
}

std::vector<PaperMap> all_maps(const std::vector<std::string>& cleaners) {
  MapBuildOptions deletion = paper_build();
  deletion.projection.policy = MovablePolicy::kDelete;
  std::vector<PaperMap> maps{{"none", "nothing removed", without_detector("none")},
                             {"deletion", "deletion", deletion}};
  for (const std::string& name : cleaners) maps.push_back({name, name, without_detector(name)});
  maps.push_back({"paper", "the paper's", paper_build(), true});
  maps.push_back({"ours", "ours", {}});
  maps.push_back({"ours-all", "ours, all points matched", {}, true});
  return maps;
}

}  // namespace

std::vector<std::string> paper_map_names(const std::vector<std::string>& cleaners) {
  std::vector<std::string> names;
  for (const PaperMap& map : all_maps(cleaners)) names.push_back(map.name);
  return names;
}

std::vector<PaperMap> paper_maps(const std::vector<std::string>& names,
                                 const std::vector<std::string>& cleaners) {
  std::vector<PaperMap> maps = all_maps(cleaners);
  const std::vector<std::string> known = paper_map_names(cleaners);
  std::set<std::string> wanted;
  for (const std::string& name : names) {
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw std::invalid_argument(
          fmt::format("maps: found '{}', expected of: {}", name, fmt::join(known, ", ")));
    if (!wanted.insert(name).second)
      throw std::invalid_argument(fmt::format("maps: found '{}' twice, expected once", name));
  }
  if (!wanted.empty())
    std::erase_if(maps, [&](const PaperMap& map) { return wanted.count(map.name) == 0; });
  return maps;
}

std::string text_of(const MapBuildOptions& options) {
  const ProjectionOptions& projection = options.projection;
  return fmt::format(
      "{} {} {} {} {} {} {} fusion {} fill {} clean {} voxel {} range {} {}", options.detector,
      name_of(projection.policy), name_of(projection.ground_height), projection.margin_m,
      projection.margin_up_m, projection.half_sweep_s, projection.classes.size(), options.fusion,
      options.fill, options.clean, options.voxel_size_m, options.min_range_m, options.max_range_m);
}

}  // namespace stillmap::mapping

#include <stillmap/mapping/reference.hpp>

#include "reference/pcl_gicp.hpp"
#include "reference/pcl_icp.hpp"
#include "reference/pcl_ndt.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

template <typename Aligner, typename Options>
std::unique_ptr<localization::Aligner> make(const std::vector<Eigen::Vector3d>& points_map) {
  return std::make_unique<Aligner>(points_map, Options{});
}

struct Reference {
  const char* name;
  std::unique_ptr<localization::Aligner> (*make)(const std::vector<Eigen::Vector3d>& points_map);
};

constexpr std::array<Reference, 3> kReferences{{
    {"pcl-icp", make<PclIcpAligner, PclIcpOptions>},
    {"ndt", make<PclNdtAligner, PclNdtOptions>},
    {"gicp", make<PclGicpAligner, PclGicpOptions>},
}};

std::vector<Eigen::Vector3d> measured_points(const maps::MapPackage& map) {
  std::vector<Eigen::Vector3d> points_map;
  for (const maps::TileEntry& entry : map.tiles()) {
    if (entry.id.level != 0) continue;
    const maps::MapTile tile = map.tile(entry.id);
    for (const maps::MapPoint& point : tile)
      if (maps::is_measured(point.kind)) points_map.push_back(tile.position(point));
  }
  return points_map;
}

}  // namespace

std::vector<std::string> map_aligner_names() {
  std::vector<std::string> names = localization::aligner_names();
  for (const Reference& reference : kReferences) names.emplace_back(reference.name);
  return names;
}

std::unique_ptr<localization::Aligner> make_map_aligner(std::string_view method,
                                                        const maps::MapPackage& map) {
  const std::vector<std::string> ours = localization::aligner_names();
  if (std::find(ours.begin(), ours.end(), method) != ours.end()) {
    return localization::make_aligner(method, map);
  }
  for (const Reference& reference : kReferences) {
    if (method == reference.name) return reference.make(measured_points(map));
  }
  throw std::invalid_argument(fmt::format("method: found '{}', expected one of: {}", method,
                                          fmt::join(map_aligner_names(), ", ")));
}

}  // namespace stillmap::mapping

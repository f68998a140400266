#include <stillmap/maps/map_graph.hpp>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/json_fields.hpp>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

#include <stillmap/maps/package_files.hpp>
#include <stillmap/maps/text.hpp>

namespace stillmap::maps {
namespace {

using nlohmann::json;

constexpr const char* kGraphFormat = "stillmap-graph";

std::size_t pose_from(const JsonField& field, std::size_t poses) {
  const std::uint64_t number = field.count();
  if (number >= poses) field.refuse("a pose of the map, below " + std::to_string(poses));
  return number;
}

MapGraph graph_from(const JsonField& field, std::size_t poses) {
  if (field.at("format").text() != kGraphFormat) field.at("format").refuse(kGraphFormat);
  if (field.at("version").count() != 1) field.at("version").refuse("1");
  MapGraph graph;
  field.at("key_frames").each([&](const JsonField& each) {
    const std::size_t pose = pose_from(each, poses);
    if (!graph.key_frames.empty() && pose <= graph.key_frames.back())
      each.refuse("numbers that ascend");
    graph.key_frames.push_back(pose);
  });
  field.at("loops").each([&](const JsonField& each) {
    graph.loops.push_back({.from = pose_from(each.at("from"), poses),
                           .to = pose_from(each.at("to"), poses),
                           .weight = each.at("weight").number(0.0, 1.0)});
  });
  return graph;
}

}  // namespace

void write_map_graph(const std::filesystem::path& package, const MapGraph& graph) {
  json loops = json::array();
  for (const MapGraph::Loop& loop : graph.loops)
    loops.push_back({{"from", loop.from}, {"to", loop.to}, {"weight", loop.weight}});
  const std::filesystem::path file = package / kGraphName;
  std::ofstream out(file, std::ios::binary);
  out << json{{"format", kGraphFormat},
              {"version", 1},
              {"key_frames", graph.key_frames},
              {"loops", std::move(loops)}}
             .dump()
      << "\n"
      << std::flush;
  if (!out) throw StorageError(file.string(), std::strerror(errno));
}

std::optional<MapGraph> read_map_graph(const MapPackage& map) {
  if (!map.manifest().files.contains(kGraphName)) return std::nullopt;
  std::size_t poses = 0;
  for (const Trajectory& drive : map.trajectories()) poses += drive.size();
  const std::filesystem::path file = map.folder() / kGraphName;
  const json document = parse_json(read_text(file), file.string());
  return graph_from(JsonField(document, file.string()), poses);
}

std::vector<std::size_t> derived_key_frames(const std::vector<Trajectory>& drives) {
  constexpr double kApartM = 1.0;
  constexpr double kApartRad = 10.0 * std::numbers::pi / 180.0;
  std::vector<std::size_t> key_frames;
  std::size_t number = 0;
  for (const Trajectory& drive : drives) {
    const StampedPose* before = nullptr;
    for (const StampedPose& pose : drive.poses()) {
      const Eigen::Isometry3d T_before_this =
          before == nullptr ? Eigen::Isometry3d::Identity()
                            : before->T_map_lidar.inverse() * pose.T_map_lidar;
      if (before == nullptr || T_before_this.translation().norm() >= kApartM ||
          rotation_angle_rad(T_before_this.linear()) >= kApartRad) {
        key_frames.push_back(number);
        before = &pose;
      }
      ++number;
    }
  }
  return key_frames;
}

}  // namespace stillmap::maps

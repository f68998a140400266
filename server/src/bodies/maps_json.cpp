#include "bodies/maps_json.hpp"

#include "bodies/registration_json.hpp"
#include "json/json_values.hpp"

#include <stillmap/maps/box.hpp>

#include <string_view>
#include <utility>

namespace stillmap::server {
namespace {

Json optional_text(const std::optional<std::string>& text) { return text ? Json(*text) : Json(); }

/// What the store knows of a map, whatever its versions hold.
Json stored(const StoredMap& map) {
  return {{"name", map.name},
          {"version", optional_text(map.active)},
          {"previous_version", optional_text(map.previous)},
          {"revision", map.revision},
          {"created_ns", std::to_string(map.created_ns)}};
}

Json refusal(const ServedVersion& version) {
  return {{"name", version.map}, {"version", version.version}, {"reason", version.failure}};
}

Json published(const StoredVersion& version) {
  Json json{{"version", version.name},
            {"digest", version.digest},
            {"bytes", version.bytes},
            {"created_ns", std::to_string(version.created_ns)}};
  if (!version.former_digests.empty()) json["former_digests"] = version.former_digests;
  return json;
}

/// How a version was made, by the keys that a list has of each.
void add_facts(Json& json, const DescribedVersion& version) {
  if (!version.facts) return;
  const VersionFacts& facts = *version.facts;
  json["points"] = facts.points;
  json["tiles"] = facts.tiles;
  json["area_m2"] = facts.area_m2;
  json["frame_id"] = facts.frame_id;
  json["frame"] = version.frame;
  json["registered_to"] = optional_text(version.registered_to);
  json["voxel_size_m"] = facts.voxel_size_m;
  json["software_version"] = facts.software_version;
  json["drives"] = facts.drives;
  json["options"] = facts.options;
  json["counts"] = facts.counts;
}

Json listed(const ListedMap& map) {
  Json entry = stored(map.stored);
  entry["state"] = map.served ? name_of(map.served->state) : "empty";
  if (!map.served || !map.served->package) return entry;
  entry["digest"] = map.served->package->digest();
  if (!map.described || !map.described->facts) return entry;
  const VersionFacts& facts = *map.described->facts;
  entry["points"] = facts.points;
  entry["tiles"] = facts.tiles;
  entry["area_m2"] = facts.area_m2;
  entry["bytes"] = map.described->stored.bytes;
  entry["version_created_ns"] = std::to_string(map.described->stored.created_ns);
  entry["voxel_size_m"] = facts.voxel_size_m;
  entry["software_version"] = facts.software_version;
  entry["drives"] = facts.drives;
  return entry;
}

}  // namespace

std::string_view name_of(MapState state) {
  switch (state) {
    case MapState::kOpened:
      return "opened";
    case MapState::kLoading:
      return "loading";
    case MapState::kReady:
      return "ready";
    case MapState::kFailed:
      break;
  }
  return "failed";
}

std::string map_list_json(const std::vector<ListedMap>& maps) {
  Json json;
  json["maps"] = Json::array();
  json["refused"] = Json::array();
  for (const ListedMap& map : maps) {
    json["maps"].push_back(listed(map));
    if (map.served && map.served->state == MapState::kFailed)
      json["refused"].push_back(refusal(*map.served));
  }
  return to_text(json);
}

std::string stored_map_json(const StoredMap& map) { return to_text(stored(map)); }

std::string version_json(const StoredVersion& version) { return to_text(published(version)); }

std::string version_list_json(const StoredMap& map, const std::vector<DescribedVersion>& versions) {
  Json json = stored(map);
  json["versions"] = Json::array();
  for (const DescribedVersion& version : versions) {
    Json entry = published(version.stored);
    entry["active"] = version.stored.name == map.active;
    entry["state"] = version.state;
    if (!version.failure.empty()) entry["failure"] = version.failure;
    add_facts(entry, version);
    json["versions"].push_back(std::move(entry));
  }
  return to_text(json);
}

std::string map_json(const StoredMap& map, const ServedVersion& version,
                     const DescribedVersion& described) {
  const maps::MapPackage& package = *version.package;
  const maps::MapManifest& manifest = package.manifest();
  Json json = stored(map);
  json["version"] = version.version;
  json["digest"] = package.digest();
  json["state"] = name_of(version.state);
  if (described.facts) {
    json["bytes"] = described.stored.bytes;
    if (!described.stored.former_digests.empty())
      json["former_digests"] = described.stored.former_digests;
    json["version_created_ns"] = std::to_string(described.stored.created_ns);
    json["points"] = described.facts->points;
    json["area_m2"] = described.facts->area_m2;
    json["frame"] = described.frame;
    json["drives"] = described.facts->drives;
  }
  json["software_version"] = manifest.software_version;
  json["options"] = manifest.options;
  json["schema"] = manifest.schema;
  json["frame_id"] = manifest.frame_id;
  json["origin"] = to_json_array(manifest.origin);
  if (const auto& origin = manifest.geodetic_origin) {
    json["geodetic_origin"] = {{"latitude_deg", origin->latitude_deg},
                               {"longitude_deg", origin->longitude_deg},
                               {"altitude_m", origin->altitude_m}};
  }
  if (manifest.registration) {
    maps::Registration registration = *manifest.registration;
    registration.previous_digest = described.registered_to.value_or(registration.previous_digest);
    json["registration"] = to_json(registration);
  }
  json["voxel_size_m"] = manifest.voxel_size_m;
  json["relative_clock"] = manifest.relative_clock;
  json["counts"] = manifest.counts;
  json["tile_size_m"] = maps::kTileSizeM;
  json["tiles"] = manifest.extent.tiles;
  const Eigen::AlignedBox3d& bounds = manifest.extent.from_origin;
  if (!bounds.isEmpty())
    json["bounds"] = {{"min", to_json_array(bounds.min())}, {"max", to_json_array(bounds.max())}};
  json["objects"] = package.objects().size();
  std::size_t poses = 0;
  for (const maps::Trajectory& drive : package.trajectories()) poses += drive.size();
  json["poses"] = poses;
  return to_text(json);
}

std::string tile_list_json(const TilePage& page) {
  Json json;
  json["tiles"] = Json::array();
  for (const maps::TileEntry& tile : page.tiles) {
    json["tiles"].push_back({{"level", tile.id.level},
                             {"x", tile.id.x},
                             {"y", tile.id.y},
                             {"points", tile.points},
                             {"min", to_json_array(tile.from_origin().min())},
                             {"max", to_json_array(tile.from_origin().max())}});
  }
  json["next"] = page.next ? Json(*page.next) : Json();
  return to_text(json);
}

std::string trajectories_json(const std::vector<maps::Trajectory>& drives) {
  Json json;
  json["poses"] = Json::array();
  for (std::size_t drive = 0; drive < drives.size(); ++drive) {
    for (const maps::StampedPose& each : drives[drive].poses()) {
      Json pose;
      pose["drive"] = drive;
      pose["stamp_ns"] = std::to_string(each.stamp_ns);
      pose.update(to_json_pose(each.T_map_lidar));
      json["poses"].push_back(std::move(pose));
    }
  }
  return to_text(json);
}

std::string delta_json(const std::string& from, const std::string& to,
                       const maps::PackageDelta& delta) {
  Json json;
  json["from"] = from;
  json["to"] = to;
  json["bytes"] = delta.bytes;
  json["missing_bytes"] = delta.missing_bytes;
  json["missing"] = Json::array();
  for (const auto& [path, file] : delta.missing)
    json["missing"].push_back({{"path", path}, {"bytes", file.bytes}, {"sha256", file.sha256}});
  return to_text(json);
}

std::string objects_json(const std::vector<maps::MapObject>& objects) {
  Json json;
  json["objects"] = Json::array();
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const maps::MapObject& object = objects[i];
    for (const maps::MapObject::Placement& place : object.placements) {
      json["objects"].push_back({{"object", i},
                                 {"scan", place.scan},
                                 {"centre", to_json_array(place.centre_map)},
                                 {"size", to_json_array(object.size_m)},
                                 {"yaw", place.yaw_rad},
                                 {"class", maps::name_of(object.object_class)},
                                 {"motion", maps::name_of(object.motion)},
                                 {"score", object.score},
                                 {"first_scan", object.first_scan},
                                 {"last_scan", object.last_scan},
                                 {"points_removed", object.points_removed}});
    }
  }
  return to_text(json);
}

}  // namespace stillmap::server

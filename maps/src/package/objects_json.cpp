#include "package/objects_json.hpp"

#include <stillmap/maps/json_fields.hpp>

#include <array>
#include <limits>
#include <nlohmann/json.hpp>

namespace stillmap::maps {
namespace {

using nlohmann::json;

json vector_json(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

json placements_json(const MapObject& object) {
  json list = json::array();
  for (const MapObject::Placement& each : object.placements)
    list.push_back(
        {{"scan", each.scan}, {"centre", vector_json(each.centre_map)}, {"yaw", each.yaw_rad}});
  return list;
}

json object_json(const MapObject& object) {
  return {{"class", name_of(object.object_class)},
          {"size", vector_json(object.size_m)},
          {"score", object.score},
          {"motion", name_of(object.motion)},
          {"drive", object.drive},
          {"first_scan", object.first_scan},
          {"last_scan", object.last_scan},
          // More digits than a double holds.
          {"first_stamp_ns", std::to_string(object.first_stamp_ns)},
          {"last_stamp_ns", std::to_string(object.last_stamp_ns)},
          {"detections", object.detections},
          {"points_removed", object.points_removed},
          {"placements", placements_json(object)}};
}

std::int64_t stamp_from(const JsonField& field) {
  const std::string text = field.text();
  std::size_t read = 0;
  try {
    const long long stamp_ns = std::stoll(text, &read);
    if (read == text.size()) return stamp_ns;
  } catch (const std::logic_error&) {
    // Not a number, or none that fits: refused below as what follows a number is.
  }
  field.refuse("nanoseconds as a decimal string");
}

MapObject object_from(const JsonField& field) {
  MapObject object;
  const auto object_class = object_class_from(field.at("class").text());
  if (!object_class) field.at("class").refuse("a class of object");
  object.object_class = *object_class;
  object.size_m = field.at("size").vector3();
  object.score = field.at("score").number(0.0, 1.0);
  const auto motion = object_motion_from(field.at("motion").text());
  if (!motion) field.at("motion").refuse("unknown, parked or moving");
  object.motion = *motion;
  object.drive = field.at("drive").count();
  object.first_scan = field.at("first_scan").count();
  object.last_scan = field.at("last_scan").count();
  object.first_stamp_ns = stamp_from(field.at("first_stamp_ns"));
  object.last_stamp_ns = stamp_from(field.at("last_stamp_ns"));
  object.detections = field.at("detections").count();
  object.points_removed = field.at("points_removed").count();
  field.at("placements").each([&](const JsonField& each) {
    object.placements.push_back(
        {each.at("scan").count(), each.at("centre").vector3(), each.at("yaw").number()});
  });
  if (object.placements.empty()) field.at("placements").refuse("at least one");
  return object;
}

}  // namespace

std::string objects_text(const std::vector<MapObject>& objects) {
  json list = json::array();
  for (const MapObject& object : objects) list.push_back(object_json(object));
  return json{{"objects", std::move(list)}}.dump() + "\n";
}

std::vector<MapObject> parse_objects(std::string_view text, const std::string& file) {
  const json document = parse_json(text, file);
  std::vector<MapObject> objects;
  JsonField(document, file).at("objects").each([&](const JsonField& field) {
    objects.push_back(object_from(field));
  });
  return objects;
}

void count_from_drive(MapObject& object, std::size_t first_scan) {
  object.drive = 0;
  object.first_scan -= first_scan;
  object.last_scan -= first_scan;
  for (MapObject::Placement& each : object.placements) each.scan -= first_scan;
}

void count_over_all(MapObject& object, std::size_t drive, std::size_t first_scan) {
  object.drive = drive;
  object.first_scan += first_scan;
  object.last_scan += first_scan;
  for (MapObject::Placement& each : object.placements) each.scan += first_scan;
}

}  // namespace stillmap::maps

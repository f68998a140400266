#include <stillmap/maps/edits.hpp>

#include <fmt/format.h>
#include <stillmap/maps/json_fields.hpp>
#include <stillmap/maps/text.hpp>

#include <numbers>
#include <string_view>
#include <vector>

namespace stillmap::maps {
namespace {

constexpr const char* kEditsFormat = "stillmap-edits";
constexpr int kEditsVersion = 1;
/// Larger than any map [m].
constexpr double kMaxCoordinateM = 1e8;
constexpr double kMaxSizeM = 10'000.0;
/// A region that goes is an object, whose ground is laid in one piece: a square of 1 km would take
/// most of a GiB [m].
constexpr double kMaxRemovedM = 200.0;
constexpr double kMaxYawRad = 4.0 * std::numbers::pi;
constexpr std::int64_t kMaxScan = 1'000'000'000;

ObjectClass class_from(const JsonField& field) {
  const auto object_class = object_class_from(field.text());
  if (!object_class)
    field.refuse("one of car van truck bus trailer tram motorcycle cyclist pedestrian unknown");
  return *object_class;
}

Box region_from(const JsonField& field) {
  field.only({"centre", "size", "yaw"});
  Box box;
  box.centre = field.at("centre").vector3(-kMaxCoordinateM, kMaxCoordinateM);
  box.size_m = field.at("size").vector3(0.0, kMaxSizeM);
  if (!(box.size_m.minCoeff() > 0.0)) field.at("size").refuse("length, width and height > 0 m");
  box.yaw_rad = field.at("yaw").number(-kMaxYawRad, kMaxYawRad);
  return box;
}

EditObject edit_object_from(const JsonField& field) {
  field.only({"centre", "class"});
  return {field.at("centre").vector3(-kMaxCoordinateM, kMaxCoordinateM),
          class_from(field.at("class"))};
}

EditScope scope_from(const JsonField& field) {
  EditScope scope;
  if (field.has("drive")) scope.drive = field.at("drive").text();
  if (!field.has("scans")) return scope;
  const JsonField scans = field.at("scans");
  if (!scope.drive) scans.refuse("a \"drive\" beside it: each drive counts its own scans");
  const std::vector<JsonField> first_and_last = scans.elements(2, 2);
  const auto first = static_cast<std::uint64_t>(first_and_last[0].integer(0, kMaxScan));
  const auto last = static_cast<std::uint64_t>(first_and_last[1].integer(0, kMaxScan));
  if (last < first) scans.refuse("a last scan that is not before the first");
  scope.scans = {first, last};
  return scope;
}

Edit edit_from(const JsonField& field) {
  field.only({"action", "box", "object", "drive", "scans", "note"});
  Edit edit;
  const std::string action = field.at("action").text();
  if (action == "remove") {
    edit.action = EditAction::kRemove;
  } else if (action != "keep") {
    field.at("action").refuse("keep or remove");
  }
  if (field.has("box") == field.has("object")) field.refuse("either \"box\" or \"object\"");
  if (field.has("box")) edit.box = region_from(field.at("box"));
  if (edit.box && edit.action == EditAction::kRemove && edit.box->size_m.maxCoeff() > kMaxRemovedM)
    field.at("box").at("size").refuse(
        fmt::format("at most {} m to remove, or several regions", kMaxRemovedM));
  if (field.has("object")) edit.object = edit_object_from(field.at("object"));
  if (field.has("note")) static_cast<void>(field.at("note").text());
  edit.scope = scope_from(field);
  return edit;
}

}  // namespace

bool EditScope::holds(const std::string& drive_name, std::size_t scan_index) const {
  if (drive && *drive != drive_name) return false;
  return !scans || (scan_index >= scans->first && scan_index <= scans->second);
}

std::string Edit::description() const {
  const Eigen::Vector3d centre = box ? box->centre : object->centre;
  return fmt::format(
      "{} {} at ({:.1f}, {:.1f}, {:.1f})", action == EditAction::kKeep ? "keep" : "remove",
      box ? "region" : name_of(object->object_class), centre.x(), centre.y(), centre.z());
}

Edits read_edits(const std::filesystem::path& file) {
  return parse_edits(read_text(file), file.string());
}

Edits parse_edits(std::string_view text, const std::string& name) {
  const nlohmann::json json = parse_json(text, name);
  const JsonField root(json, name);
  root.only({"format", "version", "edits"});
  if (root.at("format").text() != kEditsFormat) root.at("format").refuse(kEditsFormat);
  if (root.at("version").count() != kEditsVersion) root.at("version").refuse("1");
  Edits edits;
  root.at("edits").each([&](const JsonField& field) { edits.push_back(edit_from(field)); });
  return edits;
}

}  // namespace stillmap::maps

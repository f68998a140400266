#include <stillmap/maps/edits.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <stillmap/maps/error.hpp>

#include <cmath>
#include <cstring>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string_view>

#include <stillmap/maps/text.hpp>

namespace stillmap::maps {
namespace {

using Json = nlohmann::json;

constexpr const char* kEditsFormat = "stillmap-edits";
constexpr int kEditsVersion = 1;
/// Larger than any map [m].
constexpr double kMaxCoordinateM = 1e8;
constexpr double kMaxSizeM = 10'000.0;
/// A region that goes is an object, whose ground is laid in one piece: a square of 1 km would take
/// most of a GiB [m].
constexpr double kMaxRemovedM = 200.0;
constexpr double kMaxYawRad = 4.0 * std::numbers::pi;
constexpr std::uint64_t kMaxScan = 1'000'000'000;

std::string shown(const Json& value) {
  constexpr std::size_t kLongest = 60;
  if (value.is_array()) return fmt::format("an array of {}", value.size());
  if (value.is_object()) return "an object";
  const std::string text = value.dump(-1, ' ', false, Json::error_handler_t::replace);
  return text.size() > kLongest ? text.substr(0, kLongest) + "..." : text;
}

/// A value with the place it stands at, for messages.
struct Field {
  const Json& value;
  std::string where;

  [[noreturn]] void refuse(const std::string& expected) const {
    throw InputError(where, shown(value), expected);
  }
  [[nodiscard]] bool has(const char* key) const { return value.contains(key); }
  [[nodiscard]] Field at(const char* key) const {
    if (!value.is_object()) refuse(fmt::format("an object with \"{}\"", key));
    const auto found = value.find(key);
    if (found == value.end())
      throw InputError(fmt::format("{}.{}", where, key), "nothing", "a value");
    return {*found, fmt::format("{}.{}", where, key)};
  }
  /// Refuses keys that are not among those that the format has.
  void check_keys(std::initializer_list<std::string_view> known) const {
    if (!value.is_object()) refuse("an object");
    for (const auto& [key, unused] : value.items()) {
      bool found = false;
      for (const std::string_view name : known) found = found || name == key;
      if (!found)
        throw InputError(where, "\"" + key + "\"", fmt::format("only {}", fmt::join(known, ", ")));
    }
  }
  [[nodiscard]] std::string text() const {
    if (!value.is_string()) refuse("a text");
    return value.get<std::string>();
  }
  [[nodiscard]] double number(double low, double high) const {
    const std::string expected = fmt::format("a number from {} to {}", low, high);
    if (!value.is_number()) refuse(expected);
    const double number = value.get<double>();
    if (!(number >= low && number <= high)) refuse(expected);
    return number;
  }
  [[nodiscard]] std::uint64_t count() const {
    if (!value.is_number_unsigned() || value.get<std::uint64_t>() > kMaxScan)
      refuse(fmt::format("a whole number from 0 to {}", kMaxScan));
    return value.get<std::uint64_t>();
  }
  [[nodiscard]] Eigen::Vector3d vector3(double low, double high) const {
    if (!value.is_array() || value.size() != 3) refuse("three numbers");
    Eigen::Vector3d vector;
    for (std::size_t i = 0; i < 3; ++i)
      vector[static_cast<Eigen::Index>(i)] =
          Field{value[i], fmt::format("{}[{}]", where, i)}.number(low, high);
    return vector;
  }
};

ObjectClass class_from(const Field& field) {
  const auto object_class = object_class_from(field.text());
  if (!object_class)
    field.refuse("one of car van truck bus trailer tram motorcycle cyclist pedestrian unknown");
  return *object_class;
}

Box box_from(const Field& field) {
  field.check_keys({"centre", "size", "yaw"});
  Box box;
  box.centre = field.at("centre").vector3(-kMaxCoordinateM, kMaxCoordinateM);
  box.size_m = field.at("size").vector3(0.0, kMaxSizeM);
  if (!(box.size_m.minCoeff() > 0.0)) field.at("size").refuse("length, width and height > 0 m");
  box.yaw_rad = field.at("yaw").number(-kMaxYawRad, kMaxYawRad);
  return box;
}

EditObject object_from(const Field& field) {
  field.check_keys({"centre", "class"});
  return {field.at("centre").vector3(-kMaxCoordinateM, kMaxCoordinateM),
          class_from(field.at("class"))};
}

EditScope scope_from(const Field& field) {
  EditScope scope;
  if (field.has("drive")) scope.drive = field.at("drive").text();
  if (!field.has("scans")) return scope;
  const Field scans = field.at("scans");
  if (!scope.drive) scans.refuse("a \"drive\" beside it: each drive counts its own scans");
  if (!scans.value.is_array() || scans.value.size() != 2) scans.refuse("first and last scan");
  const std::uint64_t first = Field{scans.value[0], scans.where + "[0]"}.count();
  const std::uint64_t last = Field{scans.value[1], scans.where + "[1]"}.count();
  if (last < first) scans.refuse("a last scan that is not before the first");
  scope.scans = {first, last};
  return scope;
}

Edit edit_from(const Field& field) {
  field.check_keys({"action", "box", "object", "drive", "scans", "note"});
  Edit edit;
  const std::string action = field.at("action").text();
  if (action == "remove") {
    edit.action = EditAction::kRemove;
  } else if (action != "keep") {
    field.at("action").refuse("keep or remove");
  }
  if (field.has("box") == field.has("object")) field.refuse("either \"box\" or \"object\"");
  if (field.has("box")) edit.box = box_from(field.at("box"));
  if (edit.box && edit.action == EditAction::kRemove && edit.box->size_m.maxCoeff() > kMaxRemovedM)
    field.at("box").at("size").refuse(
        fmt::format("at most {} m to remove, or several regions", kMaxRemovedM));
  if (field.has("object")) edit.object = object_from(field.at("object"));
  if (field.has("note")) static_cast<void>(field.at("note").text());
  edit.scope = scope_from(field);
  return edit;
}

Json parsed(std::string_view text, const std::string& name) {
  try {
    return Json::parse(text);
  } catch (const Json::exception& error) {
    throw InputError(name, error.what(), "JSON");
  }
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
  const Json json = parsed(text, name);
  const Field root{json, name};
  root.check_keys({"format", "version", "edits"});
  if (root.at("format").text() != kEditsFormat) root.at("format").refuse(kEditsFormat);
  if (root.at("version").count() != kEditsVersion) root.at("version").refuse("1");
  const Field list = root.at("edits");
  if (!list.value.is_array()) list.refuse("an array");
  Edits edits;
  for (std::size_t i = 0; i < list.value.size(); ++i)
    edits.push_back(edit_from({list.value[i], fmt::format("{}[{}]", list.where, i)}));
  return edits;
}

}  // namespace stillmap::maps

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/json_fields.hpp>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include <stillmap/maps/text.hpp>
#include "boxes/kitti_labels.hpp"
#include "storage/write_file.hpp"

namespace stillmap::maps {
namespace {

constexpr const char* kBoxesFormat = "stillmap-boxes";
constexpr int kBoxesVersion = 1;
constexpr std::int64_t kMaxBoxTrack = 1'000'000'000;

Box box_from(const JsonField& field) {
  Box box;
  box.centre = field.at("centre").vector3();
  if (!(box.centre.cwiseAbs().maxCoeff() <= kMaxBoxDistanceM))
    field.at("centre").refuse("within 1000 km of the sensor");
  box.size_m = field.at("size").vector3();
  if (!(box.size_m.minCoeff() > 0.0 && box.size_m.maxCoeff() <= kMaxBoxSizeM))
    field.at("size").refuse("length, width and height > 0 m and at most 200 m");
  box.yaw_rad = field.at("yaw").number(-4.0 * std::numbers::pi, 4.0 * std::numbers::pi);
  const auto object_class = object_class_from(field.at("class").text());
  if (!object_class) {
    field.at("class").refuse(
        "one of car van truck bus trailer tram motorcycle cyclist pedestrian unknown");
  }
  box.object_class = *object_class;
  if (field.has("score")) box.score = field.at("score").number(0.0, 1.0);
  if (field.has("track")) {
    box.track = static_cast<int>(field.at("track").integer(-1, kMaxBoxTrack));
  }
  return box;
}

BoxSequence parse_json_boxes(const std::filesystem::path& file, std::string_view text,
                             std::size_t scan_count) {
  const nlohmann::json json = parse_json(text, file.string());
  const JsonField root(json, file.string());
  if (root.at("format").text() != kBoxesFormat) root.at("format").refuse("stillmap-boxes");
  if (root.at("version").count() != kBoxesVersion) root.at("version").refuse("1");
  BoxSequence sequence;
  root.at("scans").each([&](const JsonField& scan) {
    const std::size_t index = scan.at("scan").count();
    std::vector<Box> boxes;
    scan.at("boxes").each([&](const JsonField& field) { boxes.push_back(box_from(field)); });
    if (index >= scan_count) {
      if (!boxes.empty()) sequence.dropped["frame beyond the drive"] += boxes.size();
    } else if (!sequence.by_scan.try_emplace(index, std::move(boxes)).second) {
      scan.at("scan").refuse("each scan once");
    }
  });
  return sequence;
}

nlohmann::json to_json(const Box& box) {
  return {{"centre", {box.centre.x(), box.centre.y(), box.centre.z()}},
          {"size", {box.size_m.x(), box.size_m.y(), box.size_m.z()}},
          {"yaw", box.yaw_rad},
          {"class", name_of(box.object_class)},
          {"score", box.score},
          {"track", box.track}};
}

}  // namespace

BoxSequence read_boxes(const std::filesystem::path& file, std::size_t scan_count) {
  const std::string text = read_text(file);
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  if (first != std::string::npos && text[first] == '{') {
    return parse_json_boxes(file, text, scan_count);
  }
  return parse_kitti_labels(file, text, scan_count).boxes;
}

void write_boxes(const std::filesystem::path& file, const BoxSequence& boxes) {
  nlohmann::json scans = nlohmann::json::array();
  for (const auto& [index, of_scan] : boxes.by_scan) {
    nlohmann::json list = nlohmann::json::array();
    for (const Box& box : of_scan) list.push_back(to_json(box));
    scans.push_back({{"scan", index}, {"boxes", std::move(list)}});
  }
  const nlohmann::json json{{"format", kBoxesFormat}, {"version", kBoxesVersion}, {"scans", scans}};
  write_file(file, json.dump() + "\n");
}

}  // namespace stillmap::maps

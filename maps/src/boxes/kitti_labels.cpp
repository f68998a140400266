#include "boxes/kitti_labels.hpp"

#include <stillmap/maps/error.hpp>

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <utility>

#include <stillmap/maps/text.hpp>
#include "boxes/kitti_calibration.hpp"

namespace stillmap::maps {
namespace {

// frame track type truncated occluded alpha bbox(4) h w l x y z ry [score]
constexpr std::size_t kFields = 17;
constexpr std::size_t kTypeField = 2;

constexpr std::array<std::pair<std::string_view, ObjectClass>, 10> kTypes{{
    {"Car", ObjectClass::kCar},
    {"Van", ObjectClass::kVan},
    {"Truck", ObjectClass::kTruck},
    {"Tram", ObjectClass::kTram},
    {"Cyclist", ObjectClass::kCyclist},
    {"Pedestrian", ObjectClass::kPedestrian},
    {"Person_sitting", ObjectClass::kPedestrian},
    {"Person", ObjectClass::kPedestrian},
    {"Misc", ObjectClass::kUnknown},
    {"DontCare", ObjectClass::kUnknown},
}};

ObjectClass class_of(const std::filesystem::path& file, const NumberLine& line) {
  const std::string_view type = line.fields[kTypeField];
  const auto known = std::find_if(kTypes.begin(), kTypes.end(),
                                  [&](const auto& entry) { return entry.first == type; });
  if (known == kTypes.end()) {
    throw InputError(place(file, line.line), "type \"" + std::string(type) + "\"",
                     "one of Car Van Truck Tram Cyclist Pedestrian Person_sitting Misc DontCare");
  }
  return known->second;
}

std::vector<double> numbers_of(const std::filesystem::path& file, const NumberLine& line) {
  std::vector<double> values;
  for (std::size_t i = 0; i < line.fields.size(); ++i) {
    if (i == kTypeField) {
      values.push_back(0.0);
      continue;
    }
    const std::optional<double> value = parse_number(line.fields[i]);
    if (!value) {
      throw InputError(place(file, line.line), "\"" + std::string(line.fields[i]) + "\"",
                       "a number");
    }
    values.push_back(*value);
  }
  return values;
}

/// The label's location is the middle of the bottom face, its heading turns about the camera's y
/// (down).
Box to_lidar(const std::vector<double>& v, const Eigen::Affine3d& T_lidar_rect) {
  const double height = v[10];
  const double ry = v[16];
  Box box;
  box.size_m = {v[12], v[11], height};
  box.centre = T_lidar_rect * Eigen::Vector3d(v[13], v[14] - 0.5 * height, v[15]);
  const Eigen::Vector3d heading =
      T_lidar_rect.linear() * Eigen::Vector3d(std::cos(ry), 0.0, -std::sin(ry));
  box.yaw_rad = std::atan2(heading.y(), heading.x());
  return box;
}

void check_bounds(const std::string& where, const std::vector<double>& v) {
  constexpr double kMaxTrack = 1e9;
  const auto refuse = [&](const char* name, double found, const char* expected) {
    throw InputError(where, std::string(name) + " " + std::to_string(found), expected);
  };
  if (!(v[1] >= -1.0 && v[1] <= kMaxTrack && v[1] == std::floor(v[1]))) {
    refuse("track", v[1], "a whole number >= -1");
  }
  for (const std::size_t i : {std::size_t{10}, std::size_t{11}, std::size_t{12}}) {
    if (!(v[i] > 0.0 && v[i] <= kMaxBoxSizeM))
      refuse("size", v[i], "height, width and length > 0 m and at most 200 m");
  }
  for (const std::size_t i : {std::size_t{13}, std::size_t{14}, std::size_t{15}}) {
    if (!(std::abs(v[i]) <= kMaxBoxDistanceM))
      refuse("location", v[i], "within 1000 km of the camera");
  }
  if (v.size() > kFields && !(v[kFields] >= 0.0 && v[kFields] <= 1.0)) {
    refuse("score", v[kFields], "0 to 1");
  }
}

void check_fields(const std::filesystem::path& file, const NumberLine& line, std::size_t fields) {
  if (line.fields.size() != fields && line.fields.size() != fields + 1) {
    throw InputError(place(file, line.line), std::to_string(line.fields.size()) + " fields",
                     std::to_string(fields) + " or, with a score, " + std::to_string(fields + 1));
  }
}

/// Labels line by line.
class LabelReader {
 public:
  LabelReader(const std::filesystem::path& file, std::size_t scan_count)
      : file_(file), scan_count_(scan_count), T_lidar_rect_(read_T_rect_lidar(file).inverse()) {}

  /// @param line  with a tracking label's 17 or 18 fields.
  void add(const NumberLine& line) {
    const std::vector<double> v = numbers_of(file_, line);
    const ObjectClass object_class = class_of(file_, line);
    const std::optional<std::uint64_t> frame = parse_count(line.fields[0]);
    if (!frame) {
      throw InputError(place(file_, line.line), "frame \"" + std::string(line.fields[0]) + "\"",
                       "a whole number >= 0");
    }
    if (line.fields[kTypeField] == "DontCare") {
      ++labels_.boxes.dropped["DontCare"];
      labels_.dont_care[*frame].push_back(rectangle(line, v));
    } else if (*frame >= scan_count_) {
      ++labels_.boxes.dropped["frame beyond the drive"];
    } else if (!std::all_of(v.begin(), v.end(), [](double x) { return std::isfinite(x); })) {
      ++labels_.boxes.dropped["not finite"];
    } else {
      check_bounds(place(file_, line.line), v);
      Box box = to_lidar(v, T_lidar_rect_);
      box.object_class = object_class;
      box.track = static_cast<int>(v[1]);
      if (v.size() > kFields) box.score = v[kFields];
      labels_.boxes.by_scan[*frame].push_back(box);
    }
  }

  [[nodiscard]] KittiLabels take() { return std::move(labels_); }

 private:
  [[nodiscard]] ImageRectangle rectangle(const NumberLine& line,
                                         const std::vector<double>& v) const {
    const ImageRectangle rectangle{v[6], v[7], v[8], v[9]};
    // Written so that a NaN is refused.
    if (!(rectangle.right >= rectangle.left && rectangle.bottom >= rectangle.top)) {
      throw InputError(place(file_, line.line),
                       "a region from " + std::string(line.fields[6]) + " " +
                           std::string(line.fields[7]) + " to " + std::string(line.fields[8]) +
                           " " + std::string(line.fields[9]),
                       "left, top, right, bottom in pixels");
    }
    return rectangle;
  }

  const std::filesystem::path& file_;
  std::size_t scan_count_;
  Eigen::Affine3d T_lidar_rect_;
  KittiLabels labels_;
};

}  // namespace

KittiLabels parse_kitti_labels(const std::filesystem::path& file, std::string_view text,
                               std::size_t scan_count) {
  LabelReader reader(file, scan_count);
  for (const NumberLine& line : number_lines(text)) {
    check_fields(file, line, kFields);
    reader.add(line);
  }
  return reader.take();
}

KittiLabels parse_kitti_object_labels(const std::filesystem::path& file, std::string_view text,
                                      std::size_t scan) {
  constexpr std::string_view kNoTrack = "-1";
  const std::string frame = std::to_string(scan);
  LabelReader reader(file, scan + 1);
  for (NumberLine& line : number_lines(text)) {
    check_fields(file, line, kFields - 2);
    line.fields.insert(line.fields.begin(), {frame, kNoTrack});
    reader.add(line);
  }
  return reader.take();
}

}  // namespace stillmap::maps

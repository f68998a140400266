#include "packets/ouster_sensor.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/json_fields.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "packets/packet_bytes.hpp"

namespace stillmap::maps {
namespace {

constexpr std::size_t kPacketHeaderBytes = 32;
constexpr std::size_t kPacketFooterBytes = 32;
constexpr std::size_t kColumnHeaderBytes = 12;
constexpr std::size_t kOldColumnHeaderBytes = 16;
constexpr std::size_t kOldColumnFooterBytes = 4;
constexpr std::int64_t kMostColumnsOfTurn = 8192;
constexpr std::int64_t kMostPixels = 1024;
constexpr std::int64_t kMostPacketBytes = 65'535;

constexpr std::array<OusterProfile, 10> kProfiles{{
    {"LEGACY", 12, 1, false, 4, 6},
    {"RNG19_RFL8_SIG16_NIR16", 12, 1, false, 4, 6},
    {"RNG19_RFL8_SIG16_NIR16_ZONE16", 12, 1, false, 4, 6},
    {"RNG19_RFL8_SIG16_NIR16_RGB16", 16, 1, false, 3, 4},
    {"RNG19_RFL8_SIG16_NIR16_DUAL", 16, 2, false, 3, 8},
    {"RNG19_RFL8_SIG16_ZONE16_DUAL", 16, 2, false, 3, 8},
    {"RNG15_RFL8_NIR8", 4, 1, true, 2, 0},
    {"RNG15_RFL8_WIN8", 4, 1, true, 2, 0},
    {"RNG15_RFL8_NIR8_ZONE16", 8, 1, true, 2, 0},
    {"RNG15_RFL8_NIR8_DUAL", 8, 2, true, 2, 0},
}};

/// 16 columns of 16, 32, 64 or 128 pixels in the old profile.
bool is_old_size(std::size_t packet_bytes) {
  for (const std::size_t pixels : {16U, 32U, 64U, 128U})
    if (packet_bytes == 16 * (kOldColumnHeaderBytes + 12 * pixels + kOldColumnFooterBytes))
      return true;
  return false;
}

/// Fields of one kind: in an object of their own, or beside all others in what old drivers keep.
JsonField group(const JsonField& root, const std::string& name) {
  return root.has(name) ? root.at(name) : root;
}

const OusterProfile* profile_in(const JsonField& format) {
  if (!format.has("udp_profile_lidar")) return &kProfiles.front();
  const JsonField field = format.at("udp_profile_lidar");
  const std::string name = field.text();
  const auto found = std::ranges::find(kProfiles, name, &OusterProfile::name);
  if (found == kProfiles.end()) {
    std::string known;
    for (const OusterProfile& each : kProfiles)
      known += (known.empty() ? "" : ", ") + std::string(each.name);
    field.refuse("one of " + known + "; of another profile record the driver's PointCloud2");
  }
  return &*found;
}

std::vector<double> angles(const JsonField& field) {
  std::vector<double> angles_rad;
  for (const JsonField& each : field.elements(1, kMostPixels))
    angles_rad.push_back(each.number(-180.0, 180.0) * std::numbers::pi / 180.0);
  return angles_rad;
}

/// 16 numbers, row by row, of a rigid transform whose shift is in mm.
Eigen::Isometry3d transform_of_mm(const JsonField& field) {
  Eigen::Matrix4d matrix;
  const std::vector<JsonField> numbers = field.elements(16, 16);
  for (int i = 0; i < 16; ++i)
    matrix(i / 4, i % 4) = numbers[static_cast<std::size_t>(i)].number(-1e5, 1e5);
  const Eigen::Matrix3d R = matrix.topLeftCorner<3, 3>();
  if ((R * R.transpose() - Eigen::Matrix3d::Identity()).norm() > 1e-3 || R.determinant() < 0.0)
    field.refuse("a rotation and a shift in mm");
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = R;
  T.translation() = 1e-3 * matrix.topRightCorner<3, 1>();
  return renormalized(T);
}

/// What old metadata leaves out is what the driver assumes for the model.
double usual_beam_x_m(const std::string& model) {
  if (model.starts_with("OS-0-")) return 0.02767;
  if (model.starts_with("OS-1-")) return 0.015806;
  if (model.starts_with("OS-2-")) return 0.013762;
  return 0.012163;
}

void set_beams(OusterSensor& sensor, const JsonField& root) {
  const JsonField beams = group(root, "beam_intrinsics");
  sensor.altitude_rad = angles(beams.at("beam_altitude_angles"));
  sensor.azimuth_rad = angles(beams.at("beam_azimuth_angles"));
  if (sensor.altitude_rad.size() != sensor.azimuth_rad.size())
    beams.at("beam_azimuth_angles")
        .refuse(fmt::format("{}, as many as beam_altitude_angles", sensor.altitude_rad.size()));
  if (beams.has("beam_to_lidar_transform")) {
    const Eigen::Isometry3d T = transform_of_mm(beams.at("beam_to_lidar_transform"));
    if (!T.linear().isIdentity(1e-6) || std::abs(T.translation().y()) > 1e-6)
      beams.at("beam_to_lidar_transform").refuse("a shift along x and z");
    sensor.beam_x_m = T.translation().x();
    sensor.beam_z_m = T.translation().z();
  } else if (beams.has("lidar_origin_to_beam_origin_mm")) {
    sensor.beam_x_m = 1e-3 * beams.at("lidar_origin_to_beam_origin_mm").number(-1e3, 1e3);
  } else {
    const JsonField model = group(root, "sensor_info");
    sensor.beam_x_m =
        usual_beam_x_m(model.has("prod_line") ? model.at("prod_line").text() : std::string());
  }
}

/// "1024x10".
std::size_t columns_of_mode(const JsonField& field) {
  const std::string mode = field.text();
  for (const std::size_t columns : {512U, 1024U, 2048U, 4096U})
    if (mode.starts_with(std::to_string(columns) + "x")) return columns;
  field.refuse("a mode as 1024x10");
}

void set_format(OusterSensor& sensor, const JsonField& root) {
  const std::size_t pixels = sensor.altitude_rad.size();
  const char* const name = root.has("lidar_data_format") ? "lidar_data_format" : "data_format";
  if (!root.has(name)) {
    sensor.profile = &kProfiles.front();
    sensor.packet_columns = 16;
    sensor.columns = columns_of_mode(root.at("lidar_mode"));
    return;
  }
  const JsonField format = root.at(name);
  sensor.profile = profile_in(format);
  sensor.columns =
      static_cast<std::size_t>(format.at("columns_per_frame").integer(1, kMostColumnsOfTurn));
  sensor.packet_columns =
      static_cast<std::size_t>(format.at("columns_per_packet").integer(1, kMostColumnsOfTurn));
  if (format.at("pixels_per_column").count() != pixels)
    format.at("pixels_per_column").refuse(fmt::format("{}, as there are beam angles", pixels));
  if (format.has("header_type") && format.at("header_type").text() == "FUSA")
    format.at("header_type").refuse("STANDARD; else record the driver's PointCloud2");
  if (sensor.packet_bytes() > kMostPacketBytes)
    format.at("columns_per_packet").refuse("packets that fit into a datagram");
}

}  // namespace

bool OusterSensor::has_packet_header() const { return profile != &kProfiles.front(); }

std::size_t OusterSensor::packet_header_bytes() const {
  return has_packet_header() ? kPacketHeaderBytes : 0;
}

std::size_t OusterSensor::column_header_bytes() const {
  return has_packet_header() ? kColumnHeaderBytes : kOldColumnHeaderBytes;
}

std::size_t OusterSensor::column_bytes() const {
  return column_header_bytes() + altitude_rad.size() * profile->pixel_bytes +
         (has_packet_header() ? 0 : kOldColumnFooterBytes);
}

std::size_t OusterSensor::packet_bytes() const {
  return packet_header_bytes() + packet_columns * column_bytes() +
         (has_packet_header() ? kPacketFooterBytes : 0);
}

OusterSensor read_ouster_metadata(std::string_view text, const std::string& name) {
  const nlohmann::json json = parse_json(text, name);
  const JsonField root(json, name);
  OusterSensor sensor;
  set_beams(sensor, root);
  set_format(sensor, root);
  const JsonField lidar = group(root, "lidar_intrinsics");
  sensor.T_sensor_lidar = transform_of_mm(lidar.at("lidar_to_sensor_transform"));
  return sensor;
}

std::optional<OusterPacketHead> ouster_packet_head(std::span<const std::byte> head,
                                                   std::size_t packet_bytes) {
  constexpr std::uint16_t kLidarPacket = 1;
  if (packet_bytes < kPacketHeaderBytes + kPacketFooterBytes) return std::nullopt;
  if (is_old_size(packet_bytes))
    return OusterPacketHead{integer_at<std::uint16_t>(head, 10), integer_at<std::int64_t>(head, 0)};
  if (integer_at<std::uint16_t>(head, 0) != kLidarPacket) return std::nullopt;
  return OusterPacketHead{integer_at<std::uint16_t>(head, 2),
                          integer_at<std::int64_t>(head, kPacketHeaderBytes)};
}

}  // namespace stillmap::maps

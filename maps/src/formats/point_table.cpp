#include "formats/point_table.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string_view>

#include "formats/point_times.hpp"

namespace stillmap::maps {
namespace {

constexpr std::array<std::string_view, 5> kIntensityNames{"intensity", "i", "reflectivity",
                                                          "reflectance", "scalar_intensity"};
/// The last three are those of Aeva, Blickfeld and Cepton.
constexpr std::array<std::string_view, 8> kTimeNames{
    "t",          "time",           "timestamp",         "offset_time",
    "time_stamp", "time_offset_ns", "point_time_offset", "relative_timestamp"};

template <typename Number>
double read_as(const std::byte* bytes, bool big_endian) {
  std::array<std::byte, sizeof(Number)> raw;
  std::memcpy(raw.data(), bytes, raw.size());
  if (big_endian) std::reverse(raw.begin(), raw.end());
  Number number;
  std::memcpy(&number, raw.data(), raw.size());
  return static_cast<double>(number);
}

std::string lower(std::string text) {
  for (char& c : text) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return text;
}

std::vector<std::size_t> fields_named(std::span<const PointField> fields, std::string_view name) {
  std::vector<std::size_t> found;
  for (std::size_t i = 0; i < fields.size(); ++i) {
    if (lower(fields[i].name) == name) found.push_back(i);
  }
  return found;
}

std::string names_of(std::span<const PointField> fields) {
  std::string text = "fields";
  // Hostile headers have thousands; a message has not.
  for (const PointField& field : fields.first(std::min<std::size_t>(fields.size(), 16))) {
    text += ' ' + field.name.substr(0, 32);
  }
  return fields.empty() ? "no fields" : text;
}

}  // namespace

std::size_t size_of(NumberType type) {
  constexpr std::array<std::size_t, 10> kSizes{1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
  return kSizes.at(static_cast<std::size_t>(type));
}

bool is_whole(NumberType type) { return type != NumberType::kF32 && type != NumberType::kF64; }

double read_number(const std::byte* bytes, NumberType type, bool big_endian) {
  switch (type) {
    case NumberType::kI8:
      return read_as<std::int8_t>(bytes, big_endian);
    case NumberType::kU8:
      return read_as<std::uint8_t>(bytes, big_endian);
    case NumberType::kI16:
      return read_as<std::int16_t>(bytes, big_endian);
    case NumberType::kU16:
      return read_as<std::uint16_t>(bytes, big_endian);
    case NumberType::kI32:
      return read_as<std::int32_t>(bytes, big_endian);
    case NumberType::kU32:
      return read_as<std::uint32_t>(bytes, big_endian);
    case NumberType::kI64:
      return read_as<std::int64_t>(bytes, big_endian);
    case NumberType::kU64:
      return read_as<std::uint64_t>(bytes, big_endian);
    case NumberType::kF32:
      return read_as<float>(bytes, big_endian);
    case NumberType::kF64:
      return read_as<double>(bytes, big_endian);
  }
  return 0.0;
}

std::vector<Role> roles_of(std::span<const PointField> fields, const std::string& name) {
  std::vector<Role> roles(fields.size(), Role::kNone);
  constexpr std::array<std::string_view, 3> kAxes{"x", "y", "z"};
  constexpr std::array<Role, 3> kAxisRoles{Role::kX, Role::kY, Role::kZ};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::vector<std::size_t> found = fields_named(fields, kAxes[axis]);
    if (found.size() != 1 || fields[found[0]].count != 1) {
      throw InputError(
          name, names_of(fields),
          "one field '" + std::string(kAxes[axis]) + "' with one number a point: write x, y and z");
    }
    roles[found[0]] = kAxisRoles[axis];
  }
  for (const std::string_view candidate : kIntensityNames) {
    const std::vector<std::size_t> found = fields_named(fields, candidate);
    if (found.size() != 1 || fields[found[0]].count != 1) continue;
    roles[found[0]] = Role::kIntensity;
    break;
  }
  std::vector<std::size_t> times;
  for (const std::string_view candidate : kTimeNames) {
    const std::vector<std::size_t> found = fields_named(fields, candidate);
    times.insert(times.end(), found.begin(), found.end());
  }
  if (times.size() == 1 && fields[times[0]].count == 1) roles[times[0]] = Role::kTime;
  return roles;
}

bool is_time_name(const std::string& name) {
  return std::find(kTimeNames.begin(), kTimeNames.end(), lower(name)) != kTimeNames.end();
}

bool may_be_time_name(const std::string& name) {
  return is_time_name(name) || lower(name).find("time") != std::string::npos;
}

PointTable::PointTable(std::span<const PointField> fields, std::span<const Role> roles,
                       std::size_t points, std::optional<std::int64_t> stamp_ns)
    : stamp_ns_(stamp_ns) {
  cloud_.positions.resize(points);
  for (std::size_t i = 0; i < roles.size(); ++i) {
    if (roles[i] == Role::kIntensity) cloud_.intensities.resize(points);
    if (roles[i] != Role::kTime) continue;
    times_.resize(points);
    time_field_ = fields[i];
  }
}

void PointTable::set(Role role, std::size_t point, double value) {
  switch (role) {
    case Role::kNone:
      return;
    case Role::kX:
      cloud_.positions[point].x() = static_cast<float>(value);
      return;
    case Role::kY:
      cloud_.positions[point].y() = static_cast<float>(value);
      return;
    case Role::kZ:
      cloud_.positions[point].z() = static_cast<float>(value);
      return;
    case Role::kIntensity:
      cloud_.intensities[point] = static_cast<float>(value);
      return;
    case Role::kTime:
      times_[point] = value;
      return;
  }
}

DecodedScan PointTable::finish() && {
  DecodedScan scan;
  scan.points_in_file = cloud_.size();
  scan.dropped = drop_invalid(cloud_);
  if (!times_.empty()) {
    for (std::size_t i = 0; i < cloud_.size(); ++i) times_[i] = times_[cloud_.file_index(i)];
    times_.resize(cloud_.size());
    PointTimes times = read_point_times(times_, time_field_, stamp_ns_);
    cloud_.time_offsets_s = std::move(times.offsets_s);
    scan.times_note = std::move(times.note);
  }
  scan.cloud = std::move(cloud_);
  return scan;
}

DropCounts drop_invalid(PointCloud& cloud) {
  DropCounts dropped;
  std::vector<std::uint8_t> keep(cloud.size(), 1);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f& p = cloud.positions[i];
    if (!p.allFinite()) {
      ++dropped.non_finite;
      keep[i] = 0;
    } else if (p.x() == 0.0F && p.y() == 0.0F && p.z() == 0.0F) {
      ++dropped.zero_range;
      keep[i] = 0;
    }
  }
  cloud.keep_only(keep);
  for (float& intensity : cloud.intensities) {
    if (!std::isfinite(intensity)) intensity = 0.0F;
  }
  return dropped;
}

void check_point_count(std::uint64_t points, std::size_t max_points, const std::string& name) {
  if (points > max_points) {
    throw InputError(name, std::to_string(points) + " points",
                     "at most " + std::to_string(max_points) + ": thin the points");
  }
}

}  // namespace stillmap::maps

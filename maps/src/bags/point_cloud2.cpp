#include "bags/point_cloud2.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>
#include <string_view>
#include <vector>

#include "formats/point_table.hpp"
#include "formats/point_times.hpp"

namespace stillmap::maps {
namespace {

constexpr std::size_t kMostFields = 256;

struct CloudField {
  PointField field;
  std::size_t offset = 0;
};

struct CloudMessage {
  RosHeader header;
  std::vector<CloudField> fields;
  std::size_t height = 0;
  std::size_t width = 0;
  std::size_t point_step = 0;
  std::size_t row_step = 0;
  bool big_endian = false;
  std::span<const std::byte> data;

  [[nodiscard]] std::size_t points() const { return height * width; }
};

NumberType type_of(std::uint8_t datatype, const std::string& field, const std::string& name) {
  constexpr std::array<NumberType, 8> kTypes{NumberType::kI8,  NumberType::kU8,  NumberType::kI16,
                                             NumberType::kU16, NumberType::kI32, NumberType::kU32,
                                             NumberType::kF32, NumberType::kF64};
  if (datatype < 1 || datatype > kTypes.size())
    throw InputError(name, fmt::format("datatype {} of field '{}'", datatype, field),
                     "1 to 8 (INT8 to FLOAT64)");
  return kTypes.at(datatype - 1U);
}

CloudField read_field(MessageReader& reader) {
  CloudField field;
  field.field.name = reader.text();
  field.offset = reader.number<std::uint32_t>();
  field.field.type = type_of(reader.number<std::uint8_t>(), field.field.name, reader.name());
  field.field.count = std::max<std::size_t>(reader.number<std::uint32_t>(), 1);
  return field;
}

/// Sets the step from row to row. Rows have no gaps between them if there is only one row, if the
/// message says 0, or if its step is impossible and the points without gaps fill the data exactly:
/// some drivers write the bytes of the whole cloud, or a number of points.
void check_rows(CloudMessage& cloud, const std::string& name) {
  const std::size_t row_bytes = cloud.width * cloud.point_step;
  if (cloud.height <= 1 || cloud.row_step == 0) cloud.row_step = row_bytes;
  const auto needed = [&] {
    return cloud.points() == 0 ? 0 : (cloud.height - 1) * cloud.row_step + row_bytes;
  };
  const bool is_possible = cloud.row_step >= row_bytes && needed() <= cloud.data.size();
  if (!is_possible && cloud.data.size() == cloud.height * row_bytes) cloud.row_step = row_bytes;
  if (cloud.row_step < row_bytes)
    throw InputError(name, fmt::format("row_step {}", cloud.row_step),
                     fmt::format("{}, {} points of {} bytes: mend the program that writes it",
                                 row_bytes, cloud.width, cloud.point_step));
  if (cloud.data.size() < needed())
    throw InputError(name, fmt::format("{} bytes of points", cloud.data.size()),
                     fmt::format("{}, {} x {} points of {} bytes: mend the program that writes it",
                                 needed(), cloud.height, cloud.width, cloud.point_step));
}

CloudMessage read_message(MessageReader& reader, std::size_t max_points) {
  CloudMessage cloud;
  cloud.header = read_header(reader);
  cloud.height = reader.number<std::uint32_t>();
  cloud.width = reader.number<std::uint32_t>();
  // Both fit 32 bits, their product 64.
  check_point_count(std::uint64_t{cloud.height} * cloud.width, max_points, reader.name());
  constexpr std::size_t kLeastFieldBytes = 4 + 4 + 1 + 4;
  const std::size_t fields = reader.count(kLeastFieldBytes);
  if (fields > kMostFields)
    throw InputError(reader.name(), fmt::format("{} fields", fields),
                     fmt::format("at most {}", kMostFields));
  for (std::size_t i = 0; i < fields; ++i) cloud.fields.push_back(read_field(reader));
  cloud.big_endian = reader.flag();
  cloud.point_step = reader.number<std::uint32_t>();
  cloud.row_step = reader.number<std::uint32_t>();
  cloud.data = reader.bytes();
  for (const CloudField& field : cloud.fields) {
    if (field.offset + field.field.count * size_of(field.field.type) <= cloud.point_step) continue;
    throw InputError(reader.name(),
                     fmt::format("field '{}' of {} x {} bytes at {}", field.field.name,
                                 field.field.count, size_of(field.field.type), field.offset),
                     fmt::format("within the point_step of {}", cloud.point_step));
  }
  check_rows(cloud, reader.name());
  return cloud;
}

template <typename Number, typename Set>
void each_value(const CloudMessage& cloud, std::size_t offset, const Set& set) {
  std::size_t i = 0;
  for (std::size_t row = 0; row < cloud.height; ++row) {
    const std::byte* at = cloud.data.data() + row * cloud.row_step + offset;
    for (std::size_t column = 0; column < cloud.width; ++column, at += cloud.point_step) {
      std::array<std::byte, sizeof(Number)> raw;
      std::memcpy(raw.data(), at, raw.size());
      if (cloud.big_endian) std::reverse(raw.begin(), raw.end());
      Number value;
      std::memcpy(&value, raw.data(), raw.size());
      set(i++, value);
    }
  }
}

/// One pass for each column, so that its type is looked at once and not for each point.
template <typename Set>
void each_value(const CloudMessage& cloud, const CloudField& field, const Set& set) {
  switch (field.field.type) {
    case NumberType::kI8:
      return each_value<std::int8_t>(cloud, field.offset, set);
    case NumberType::kU8:
      return each_value<std::uint8_t>(cloud, field.offset, set);
    case NumberType::kI16:
      return each_value<std::int16_t>(cloud, field.offset, set);
    case NumberType::kU16:
      return each_value<std::uint16_t>(cloud, field.offset, set);
    case NumberType::kI32:
      return each_value<std::int32_t>(cloud, field.offset, set);
    case NumberType::kU32:
      return each_value<std::uint32_t>(cloud, field.offset, set);
    case NumberType::kF32:
      return each_value<float>(cloud, field.offset, set);
    case NumberType::kF64:
      return each_value<double>(cloud, field.offset, set);
    case NumberType::kI64:
    case NumberType::kU64:
      return;  // PointCloud2 has none
  }
}

/// Times of the points that were kept, since those without a return often have none.
void set_times(DecodedScan& scan, const CloudMessage& cloud, const CloudField& field) {
  std::vector<double> all(cloud.points());
  each_value(cloud, field, [&](std::size_t i, auto value) { all[i] = static_cast<double>(value); });
  std::vector<double> kept(scan.cloud.size());
  for (std::size_t i = 0; i < kept.size(); ++i) kept[i] = all[scan.cloud.file_index(i)];
  PointTimes times = read_point_times(kept, field.field, cloud.header.stamp_ns);
  scan.cloud.time_offsets_s = std::move(times.offsets_s);
  scan.times_note = std::move(times.note);
}

void set_column(PointCloud& points, const CloudMessage& cloud, const CloudField& field, Role role) {
  const auto set_axis = [&](int axis) {
    each_value(cloud, field, [&](std::size_t i, auto value) {
      points.positions[i][axis] = static_cast<float>(value);
    });
  };
  switch (role) {
    case Role::kX:
      return set_axis(0);
    case Role::kY:
      return set_axis(1);
    case Role::kZ:
      return set_axis(2);
    case Role::kIntensity:
      points.intensities.resize(points.size());
      return each_value(cloud, field, [&](std::size_t i, auto value) {
        points.intensities[i] = static_cast<float>(value);
      });
    case Role::kTime:
    case Role::kNone:
      return;
  }
}

}  // namespace

DecodedScan decode_point_cloud2(MessageReader& reader, std::size_t max_points) {
  const CloudMessage cloud = read_message(reader, max_points);
  // Drivers send empty ones without any field.
  if (cloud.points() == 0) return {};
  std::vector<PointField> fields;
  for (const CloudField& each : cloud.fields) fields.push_back(each.field);
  const std::vector<Role> roles = roles_of(fields, reader.name());
  DecodedScan scan;
  scan.points_in_file = cloud.points();
  scan.cloud.positions.resize(cloud.points());
  for (std::size_t i = 0; i < roles.size(); ++i)
    set_column(scan.cloud, cloud, cloud.fields[i], roles[i]);
  scan.dropped = drop_invalid(scan.cloud);
  const auto time = std::find(roles.begin(), roles.end(), Role::kTime);
  if (time != roles.end())
    set_times(scan, cloud, cloud.fields[static_cast<std::size_t>(time - roles.begin())]);
  return scan;
}

std::vector<std::string> fields_of_point_cloud2(MessageReader& reader) {
  constexpr std::array<std::string_view, 10> kNames{"i8",  "u8",  "i16", "u16", "i32",
                                                    "u32", "i64", "u64", "f32", "f64"};
  std::vector<std::string> fields;
  for (const CloudField& each :
       read_message(reader, std::numeric_limits<std::uint32_t>::max()).fields) {
    const std::string count = each.field.count == 1 ? "" : fmt::format(" x{}", each.field.count);
    fields.push_back(fmt::format("{} {}{}", each.field.name.substr(0, 32),
                                 kNames.at(static_cast<std::size_t>(each.field.type)), count));
  }
  return fields;
}

}  // namespace stillmap::maps

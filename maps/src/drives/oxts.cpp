#include "drives/oxts.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <GeographicLib/LocalCartesian.hpp>
#include <array>
#include <chrono>
#include <cmath>
#include <optional>

#include <stillmap/maps/text.hpp>
#include "drives/layout.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kOxtsFields = 30;

/// One number out of a text such as `2011-09-26`, `13:10:51`.
std::optional<int> part(std::string_view text, std::size_t begin, std::size_t length) {
  if (begin + length > text.size()) return std::nullopt;
  const std::optional<std::uint64_t> value = parse_count(text.substr(begin, length));
  if (!value) return std::nullopt;
  return static_cast<int>(*value);
}

std::optional<std::int64_t> parse_date_time(std::string_view date, std::string_view time) {
  const std::optional<int> year = part(date, 0, 4);
  const std::optional<int> month = part(date, 5, 2);
  const std::optional<int> day = part(date, 8, 2);
  const std::optional<int> hour = part(time, 0, 2);
  const std::optional<int> minute = part(time, 3, 2);
  if (!year || !month || !day || !hour || !minute || date.size() != 10 || time.size() < 8 ||
      date[4] != '-' || date[7] != '-' || time[2] != ':' || time[5] != ':') {
    return std::nullopt;
  }
  const std::optional<std::int64_t> second_ns = parse_stamp_ns(time.substr(6));
  const std::chrono::year_month_day ymd(std::chrono::year(*year),
                                        std::chrono::month(static_cast<unsigned>(*month)),
                                        std::chrono::day(static_cast<unsigned>(*day)));
  // 60: a leap second.
  if (!ymd.ok() || *year < 1970 || *year > 2200 || *hour > 23 || *minute > 59 || !second_ns ||
      *second_ns < 0 || *second_ns >= 61'000'000'000) {
    return std::nullopt;
  }
  const std::int64_t days = std::chrono::sys_days(ymd).time_since_epoch().count();
  return ((days * 24 + *hour) * 60 + *minute) * 60'000'000'000 + *second_ns;
}

struct OxtsPacket {
  double latitude_deg, longitude_deg, altitude_m, roll_rad, pitch_rad, yaw_rad;
};

OxtsPacket read_packet(const fs::path& file) {
  const std::string text = read_text(file);
  const std::vector<NumberLine> lines = number_lines(text);
  if (lines.size() != 1 || lines[0].fields.size() != kOxtsFields) {
    throw InputError(file.string(),
                     fmt::format("{} lines, the first of {} fields", lines.size(),
                                 lines.empty() ? 0 : lines[0].fields.size()),
                     fmt::format("one line of {} numbers", kOxtsFields));
  }
  NumberLine pose = lines[0];
  pose.fields.resize(6);
  std::array<double, 6> n{};
  parse_finite(file, pose, n);
  if (!(std::abs(n[0]) <= 90.0) || !(std::abs(n[1]) <= 360.0)) {
    throw InputError(file.string(), fmt::format("latitude {}, longitude {}", n[0], n[1]),
                     "degrees within 90 and 360");
  }
  return {n[0], n[1], n[2], n[3], n[4], n[5]};
}

Eigen::Isometry3d T_map_imu_of(const OxtsPacket& packet,
                               const GeographicLib::LocalCartesian& local) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  // Up and north here are not those at the origin: 1 km away they differ by 0.16 mrad and, at 49
  // degrees, 0.18 mrad.
  std::vector<double> m(9);
  local.Forward(packet.latitude_deg, packet.longitude_deg, packet.altitude_m, T.translation().x(),
                T.translation().y(), T.translation().z(), m);
  const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R_map_here(m.data());
  // Yaw 0 is east, counter-clockwise; positive pitch is front down; positive roll is left side up.
  T.linear() = R_map_here * (Eigen::AngleAxisd(packet.yaw_rad, Eigen::Vector3d::UnitZ()) *
                             Eigen::AngleAxisd(packet.pitch_rad, Eigen::Vector3d::UnitY()) *
                             Eigen::AngleAxisd(packet.roll_rad, Eigen::Vector3d::UnitX()))
                                .toRotationMatrix();
  return T;
}

}  // namespace

std::vector<std::optional<std::int64_t>> read_kitti_stamps(const fs::path& file) {
  const std::string text = read_text(file);
  std::vector<std::optional<std::int64_t>> stamps;
  for (const NumberLine& line : number_lines(text)) {
    // A file's number is its line: a hole must not shift those that follow.
    stamps.resize(line.line - 1);
    const std::optional<std::int64_t> stamp =
        line.fields.size() == 2 ? parse_date_time(line.fields[0], line.fields[1]) : std::nullopt;
    if (!stamp) {
      throw InputError(place(file, line.line),
                       "'" + std::string(line.fields[0]) + (line.fields.size() > 1 ? " " : "") +
                           std::string(line.fields.size() > 1 ? line.fields[1] : "") + "'",
                       "YYYY-MM-DD hh:mm:ss.fraction");
    }
    stamps.push_back(*stamp);
  }
  return stamps;
}

OxtsPath read_oxts(const fs::path& folder) {
  const fs::path stamps_file = folder / "timestamps.txt";
  const std::vector<std::optional<std::int64_t>> stamps = read_kitti_stamps(stamps_file);
  OxtsPath path;
  std::optional<GeographicLib::LocalCartesian> local;
  std::size_t unordered = 0, without_stamp = 0;
  for (const fs::path& file : list_files(folder / "data", ".txt")) {
    const std::optional<std::size_t> number = number_of(file);
    if (!number || *number >= stamps.size()) {
      throw InputError(
          file.string(), fmt::format("no stamp for it among {} lines", stamps.size()),
          "its number as a line (from 0) of " + stamps_file.string() + ": copy the whole file");
    }
    const std::optional<std::int64_t> stamp = stamps[*number];
    if (!stamp || (!path.T_map_imu.empty() && *stamp <= path.T_map_imu.back().stamp_ns)) {
      ++(stamp ? unordered : without_stamp);
      continue;
    }
    const OxtsPacket packet = read_packet(file);
    if (!local) {
      local.emplace(packet.latitude_deg, packet.longitude_deg, packet.altitude_m);
      path.origin = {packet.latitude_deg, packet.longitude_deg, packet.altitude_m};
    }
    path.T_map_imu.push_back({*stamp, T_map_imu_of(packet, *local)});
  }
  if (path.T_map_imu.empty()) {
    throw InputError((folder / "data").string(), "no oxts packets", "*.txt files: copy them there");
  }
  if (without_stamp > 0)
    path.notes.push_back(fmt::format("{} oxts packets left out, whose lines of {} are blank",
                                     without_stamp, stamps_file.filename().string()));
  if (unordered > 0) {
    path.notes.push_back(fmt::format(
        "{} oxts packets left out, whose stamps are not after the one before", unordered));
  }
  return path;
}

}  // namespace stillmap::maps

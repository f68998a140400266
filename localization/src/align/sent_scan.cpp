#include <stillmap/localization/thinning.hpp>
#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <zstd.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

namespace stillmap::localization {

static_assert(std::endian::native == std::endian::little, "sent scans are little-endian");

namespace {

constexpr std::size_t kMostSentPoints = thin_detail::kMaxRead;
/// As of raw scans.
constexpr float kMostSentTimeS = 1.0F;

/// The fields of localization/thin_scan.md, in their order.
struct SentHeader {
  std::array<char, 4> magic;
  std::uint8_t version, profile, flags, unused;
  std::uint32_t points, matched, scan_points, no_returns;
  float cell_m, own_vehicle_m, step_m, step_s;
  std::uint32_t reserved;

  [[nodiscard]] bool is_compact() const { return profile == 1; }
  [[nodiscard]] bool has(std::uint8_t flag) const { return (flags & flag) != 0; }
  [[nodiscard]] std::size_t values() const { return has(thin_detail::kHasTimes) ? 4 : 3; }
  [[nodiscard]] std::size_t payload_bytes() const {
    return points * values() * (is_compact() ? sizeof(std::int16_t) : sizeof(float));
  }
};
static_assert(sizeof(SentHeader) == thin_detail::kHeaderBytes);

SentHeader read_header(std::span<const std::byte> bytes, const std::string& name) {
  const auto refuse = [&](const std::string& found, const std::string& expected) {
    throw maps::InputError(name, found, expected + ": write it as localization/thin_scan.md says");
  };
  SentHeader header;
  if (bytes.size() < sizeof(header))
    refuse(fmt::format("{} bytes", bytes.size()), fmt::format("{} or more", sizeof(header)));
  std::memcpy(&header, bytes.data(), sizeof(header));
  constexpr std::uint8_t kFlags =
      thin_detail::kHasTimes | thin_detail::kNearKept | thin_detail::kZstd;
  if (std::memcmp(header.magic.data(), "SMTS", 4) != 0) refuse("other bytes", "SMTS in front");
  if (header.version != thin_detail::kVersion)
    refuse(fmt::format("version {}", header.version), "version 1");
  if (header.profile > 1 || (header.flags & ~kFlags) != 0 || header.unused != 0 ||
      header.reserved != 0)
    refuse(fmt::format("profile {} and flags {}", header.profile, header.flags),
           "profile 0 or 1, and of the flags 1, 2 and 4 alone");
  if (header.points > kMostSentPoints || header.matched > kMaxQueryPoints ||
      header.matched > header.points)
    refuse(fmt::format("{} points, {} of them matched", header.points, header.matched),
           fmt::format("at most {}, and of these {}", kMostSentPoints, kMaxQueryPoints));
  if (header.scan_points < header.points)
    refuse(fmt::format("{} points of a scan of {}", header.points, header.scan_points),
           "no more than the scan has");
  if (header.cell_m != thin_detail::kCellM && header.cell_m != 0.5F * thin_detail::kCellM)
    refuse(fmt::format("cells of {} m", header.cell_m), "0.5 or 0.25");
  for (const float number : {header.own_vehicle_m, header.step_m, header.step_s})
    if (!(number >= 0.0F && number < thin_detail::kMaxRangeM))
      refuse(fmt::format("{} in the header", number), "a length or time of 0 and more");
  return header;
}

/// The payload, unpacked into `room` where it is packed.
std::span<const std::byte> payload_of(const SentHeader& header, std::span<const std::byte> bytes,
                                      const std::string& name, std::vector<std::byte>& room) {
  const std::span<const std::byte> rest = bytes.subspan(sizeof(header));
  const std::size_t size = header.payload_bytes();
  if (!header.has(thin_detail::kZstd)) {
    if (rest.size() == size) return rest;
    throw maps::InputError(
        name, fmt::format("{} bytes behind the header", rest.size()),
        fmt::format("{} for {} points: send it whole, and no more", size, header.points));
  }
  room.resize(size);
  const std::size_t got = ZSTD_decompress(room.data(), size, rest.data(), rest.size());
  if (ZSTD_isError(got) != 0 || got != size)
    throw maps::InputError(name, "a zstd frame of another size, or a broken one",
                           fmt::format("one of {} bytes: pack the payload again", size));
  return room;
}

template <typename Value>
Value value_at(std::span<const std::byte> payload, std::size_t number) {
  Value value;
  std::memcpy(&value, &payload[number * sizeof(Value)], sizeof(Value));
  return value;
}

void take_exact(const SentHeader& header, std::span<const std::byte> payload,
                maps::PointCloud& cloud) {
  for (std::size_t i = 0; i < header.points; ++i) {
    for (Eigen::Index axis = 0; axis < 3; ++axis)
      cloud.positions[i][axis] = value_at<float>(payload, 3 * i + static_cast<std::size_t>(axis));
    if (!cloud.time_offsets_s.empty())
      cloud.time_offsets_s[i] = value_at<float>(payload, std::size_t{3} * header.points + i);
  }
}

void take_compact(const SentHeader& header, std::span<const std::byte> payload,
                  maps::PointCloud& cloud) {
  const auto step = [&](std::size_t plane, std::size_t i) {
    return static_cast<float>(value_at<std::int16_t>(payload, plane * header.points + i));
  };
  for (std::size_t i = 0; i < header.points; ++i) {
    cloud.positions[i] = header.step_m * Eigen::Vector3f(step(0, i), step(1, i), step(2, i));
    if (!cloud.time_offsets_s.empty()) cloud.time_offsets_s[i] = header.step_s * step(3, i);
  }
}

void require_bounds(const maps::PointCloud& cloud, const std::string& name) {
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (!(cloud.positions[i].norm() <= 1.01F * thin_detail::kMaxRangeM))
      throw maps::InputError(name, fmt::format("point {} beyond {} m", i, thin_detail::kMaxRangeM),
                             "nearer ones: leave out what is farther");
    if (!cloud.time_offsets_s.empty() && !(std::abs(cloud.time_offsets_s[i]) <= kMostSentTimeS))
      throw maps::InputError(
          name, fmt::format("point {} at {} s", i, cloud.time_offsets_s[i]),
          fmt::format("within {} s of the scan's stamp: write times that count from this stamp",
                      kMostSentTimeS));
  }
}

}  // namespace

SentScan decode_thin_scan(std::span<const std::byte> bytes, const std::string& name) {
  const SentHeader header = read_header(bytes, name);
  std::vector<std::byte> room;
  const std::span<const std::byte> payload = payload_of(header, bytes, name, room);
  SentScan sent;
  sent.points = header.scan_points;
  sent.no_returns = header.no_returns;
  sent.scan.matched = header.matched;
  sent.scan.own_vehicle_m = header.own_vehicle_m;
  maps::PointCloud& cloud = sent.scan.points_lidar;
  cloud.positions.resize(header.points);
  if (header.has(thin_detail::kHasTimes)) cloud.time_offsets_s.resize(header.points);
  header.is_compact() ? take_compact(header, payload, cloud) : take_exact(header, payload, cloud);
  require_bounds(cloud, name);
  return sent;
}

}  // namespace stillmap::localization

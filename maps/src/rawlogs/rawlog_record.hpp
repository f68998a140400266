#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <type_traits>

/// What the program that reads rawlogs says of one, on its standard output, and what it is told to
/// write: records, one behind the other. It and its caller are of one build and on one machine.
namespace stillmap::maps {

static_assert(std::endian::native == std::endian::little);

enum class RawlogRecordKind : std::uint32_t {
  kScan = 1,
  kPose = 2,
  /// The last one; without it the program ended before its time.
  kEnd = 3,
  /// Of a simplemap.
  kKeyframe = 4,
};

/// Where a pose comes from; the better ones have the larger numbers.
enum class RawlogPoseSource : std::uint32_t { kActions = 0, kOdometry = 1, kRobotPose = 2 };

/// Behind it follow `text_bytes` of text and `points` points.
struct RawlogRecord {
  RawlogRecordKind kind = RawlogRecordKind::kEnd;
  /// Of a scan: the sensor's label. Of the end: why it came too early, if it did.
  std::uint32_t text_bytes = 0;
  /// Since the Unix epoch; `kNoRawlogStamp` where there is none.
  std::int64_t stamp_ns = 0;
  /// 3x4 row-major. Of a scan T_base_lidar, of a pose T_odom_base, of a keyframe T_map_lidar (of
  /// local coordinates less the map's origin).
  std::array<double, 12> pose{};
  std::uint32_t points = 0;
  /// Of a scan: `kRawlogIntensities`, `kRawlogTimes`. Of a pose: a RawlogPoseSource.
  std::uint32_t flags = 0;
  /// Of the end: objects read, and observations of clouds that could not be used.
  std::uint64_t objects = 0;
  std::uint64_t unusable = 0;
};
static_assert(std::is_trivially_copyable_v<RawlogRecord> && sizeof(RawlogRecord) == 136);

/// Coordinates [m] in the sensor's frame, the time [s] relative to the record's stamp.
struct RawlogPoint {
  float x = 0.0F;
  float y = 0.0F;
  float z = 0.0F;
  float intensity = 0.0F;
  float time_s = 0.0F;
};
static_assert(sizeof(RawlogPoint) == 20);

inline constexpr std::int64_t kNoRawlogStamp = INT64_MIN;
inline constexpr std::uint32_t kRawlogIntensities = 1;
inline constexpr std::uint32_t kRawlogTimes = 2;
inline constexpr std::uint32_t kMostRawlogPoints = 4'000'000;
inline constexpr std::uint32_t kMostRawlogText = 4096;

}  // namespace stillmap::maps

#pragma once

#include <stillmap/maps/scan_file.hpp>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace stillmap::maps {

/// Farthest a point's time may be from its scan's stamp [s]: a sweep takes 0.05 to 0.2 s, a second
/// is beyond any.
inline constexpr float kMaxTimeOffsetS = 1.0F;

/// Kinds of numbers in PCD and PLY.
enum class NumberType { kI8, kU8, kI16, kU16, kI32, kU32, kI64, kU64, kF32, kF64 };

[[nodiscard]] std::size_t size_of(NumberType type);
[[nodiscard]] bool is_whole(NumberType type);
/// @param bytes  at least size_of(type) of them, not aligned.
[[nodiscard]] double read_number(const std::byte* bytes, NumberType type, bool big_endian = false);

/// A column of a point file. `count` numbers a point, 0 allowed.
struct PointField {
  std::string name;
  NumberType type = NumberType::kF32;
  std::size_t count = 1;
};

/// What a column is to us.
enum class Role { kNone, kX, kY, kZ, kIntensity, kTime };

/// One role a field, by its name in any case. Intensity: `intensity`, `i`, `reflectivity`,
/// `reflectance` (the first of these that is there) and `scalar_intensity`. Time: `t`, `time`,
/// `timestamp`, `offset_time`, `time_stamp`, `time_offset_ns`, `point_time_offset`,
/// `relative_timestamp`, if there is exactly one of them.
/// @param name  of the file, for messages.
/// @throws InputError when x, y or z is missing, doubled or not one number, naming the fields
/// found.
[[nodiscard]] std::vector<Role> roles_of(std::span<const PointField> fields,
                                         const std::string& name);

/// Whether a column of this name, in any case, may be the time.
[[nodiscard]] bool is_time_name(const std::string& name);
/// Whether it may be the time for people: it also counts when `roles_of` does not know the name.
[[nodiscard]] bool may_be_time_name(const std::string& name);

/// Collects the columns of a known number of points, then drops what is no point.
class PointTable {
 public:
  /// Allocates for `points`; the caller has checked them against the bytes at hand.
  /// @param stamp_ns  of the scan, where it is known.
  PointTable(std::span<const PointField> fields, std::span<const Role> roles, std::size_t points,
             std::optional<std::int64_t> stamp_ns);

  [[nodiscard]] std::size_t size() const { return cloud_.size(); }
  void set(Role role, std::size_t point, double value);
  /// All points below this one are set: nothing to do for a table that holds them all.
  void reached(std::size_t /*end*/) {}
  /// Drops NaN, infinite and zero-range points, and reads the times of the others
  /// (point_times.hpp).
  [[nodiscard]] DecodedScan finish() &&;

 private:
  PointCloud cloud_;
  /// As they stand in the column; empty without one.
  std::vector<double> times_;
  PointField time_field_;
  std::optional<std::int64_t> stamp_ns_;
};

/// Removes points that are not finite or have zero range, in place and in order, with their
/// attributes; an intensity that is not finite becomes 0.
[[nodiscard]] DropCounts drop_invalid(PointCloud& cloud);

/// @throws InputError if there are more than allowed.
void check_point_count(std::uint64_t points, std::size_t max_points, const std::string& name);

}  // namespace stillmap::maps

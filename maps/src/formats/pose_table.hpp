#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// Cells of a line of a table: parted by `separator`, with blanks and quotes around them cut off;
/// by blanks where it is ' '.
[[nodiscard]] std::vector<std::string_view> split_cells(std::string_view line, char separator);

/// What parts the cells of a line: ';', ',' or ' '.
[[nodiscard]] char separator_of(std::string_view line);

/// Unit of stamps, as a power of ten seconds.
enum class StampUnit { kSeconds = 0, kMilliseconds = -3, kMicroseconds = -6, kNanoseconds = -9 };

/// Exact, as `parse_stamp_ns`.
[[nodiscard]] std::optional<std::int64_t> parse_stamp(std::string_view text, StampUnit unit);

/// Seconds, unless the number is so large that it counts smaller units since 1970.
[[nodiscard]] StampUnit unit_of_stamp(std::string_view text);

/// Where a table's header says that its poses are.
struct PoseColumns {
  std::array<std::size_t, 3> position{};
  /// x y z w, or roll pitch yaw.
  std::array<std::size_t, 4> rotation{};
  bool is_quaternion = true;
  /// Units of roll, pitch and yaw [rad]; nothing where the header names none.
  std::array<std::optional<double>, 3> angle_unit_rad;
  std::optional<std::size_t> stamp;
  /// Nothing where the header does not name it.
  std::optional<StampUnit> stamp_unit;
  /// Nanoseconds beside whole seconds in `stamp`.
  std::optional<std::size_t> nanoseconds;
  /// The scan's number, where there is no stamp.
  std::optional<std::size_t> number;
  /// Of all columns.
  std::size_t count = 0;

  /// The last of the columns that are read.
  [[nodiscard]] std::size_t last() const;
};

/// @param where  file and line, for messages.
/// @return nothing where the names are none of a pose's.
/// @throws InputError where two columns could be meant, and for units other than metres, radians,
/// degrees and parts of a second.
[[nodiscard]] std::optional<PoseColumns> parse_pose_header(std::string_view line,
                                                           const std::string& where);

}  // namespace stillmap::maps

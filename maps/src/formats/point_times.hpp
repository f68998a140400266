#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "formats/point_table.hpp"

namespace stillmap::maps {

/// Times of the points of one scan [s], from its stamp.
struct PointTimes {
  /// Empty where the column cannot be read as times.
  std::vector<float> offsets_s;
  /// For people: as what the column was read where that is not plain, or why it was not. Empty when
  /// there is nothing to say.
  std::string note;
};

/// A column of times, as drivers write it: from the scan's stamp or from the zero of a clock, in s,
/// ms, us or ns (floating types), or in ns or us (whole ones).
///
/// Plain are seconds (floating) and nanoseconds (whole) within 1 s of the stamp, that span at least
/// 2 ms or nothing. Else the unit counts in which the scan takes 20 to 250 ms, as sweeps do. What
/// lies farther off counts from a clock's zero: that of the stamp where it lies within 1 s of it;
/// of another clock otherwise, and then the first point's time is taken for the stamp's.
/// @param values    of the points that were kept, in any order.
/// @param field     its name and type.
/// @param stamp_ns  of the scan, where it is known.
[[nodiscard]] PointTimes read_point_times(std::span<const double> values, const PointField& field,
                                          std::optional<std::int64_t> stamp_ns);

}  // namespace stillmap::maps

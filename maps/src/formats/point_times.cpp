#include "formats/point_times.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string_view>

namespace stillmap::maps {
namespace {

constexpr std::int64_t kNsOfSecond = 1'000'000'000;
/// A shorter sweep than sensors make, if times are not of one instant.
constexpr double kLeastSpanS = 0.002;
/// Turns and frames take 50 to 200 ms.
constexpr double kLeastSweepS = 0.02;
constexpr double kMostSweepS = 0.25;
/// Fewer may be a small part of a sweep, whose span tells no unit.
constexpr std::size_t kFewestPoints = 1000;
/// Digits that times of points need [s].
constexpr double kCoarsestS = 0.001;

struct Unit {
  double s = 1.0;
  std::string_view name;
};
constexpr std::array<Unit, 4> kUnits{
    {{1.0, "seconds"}, {1e-3, "milliseconds"}, {1e-6, "microseconds"}, {1e-9, "nanoseconds"}}};

/// Time from the stamp of a value that counts from the zero of the stamp's clock [s].
double from_stamp_s(double value, double unit_s, std::int64_t stamp_ns) {
  // A double of today's nanoseconds has the same steps as the stamp has then.
  if (unit_s == 1e-9) return (value - static_cast<double>(stamp_ns)) * unit_s;
  const double units_per_s = 1.0 / unit_s;
  const double whole = static_cast<double>(stamp_ns / kNsOfSecond) * units_per_s;
  return (value - whole) * unit_s - 1e-9 * static_cast<double>(stamp_ns % kNsOfSecond);
}

class Column {
 public:
  Column(std::span<const double> values, const PointField& field,
         std::optional<std::int64_t> stamp_ns)
      : values_(values), field_(field), stamp_ns_(stamp_ns) {
    const auto [least, most] = std::minmax_element(values.begin(), values.end());
    least_ = *least;
    most_ = *most;
  }

  [[nodiscard]] PointTimes read() const {
    const Unit& plain = is_whole(field_.type) ? kUnits[3] : kUnits[0];
    if (is_near_stamp(plain)) {
      if (const Unit* unit = span_s(plain) < kLeastSpanS ? unit_of_sweep() : nullptr;
          unit != nullptr && is_near_stamp(*unit) && values_.size() >= kFewestPoints)
        return from(0.0, *unit, taken_as(*unit));
      return from(0.0, plain, {});
    }
    for (const Unit& unit : units())
      if (is_near_stamps_clock(unit)) return from_stamp(unit);
    const Unit* const unit = unit_of_sweep();
    if (unit == nullptr)
      return left_out(fmt::format("they span {:.3g}, which is no sweep's time in any unit known",
                                  most_ - least_));
    if (is_near_stamp(*unit)) return from(0.0, *unit, taken_as(*unit));
    if (digits_s(*unit) > kCoarsestS)
      return left_out(
          fmt::format("32-bit floats have steps of {:.2g} s at {:.9g}", digits_s(*unit), most_));
    return from(least_, *unit,
                fmt::format("the times of points in '{}' count from the zero of another clock than "
                            "the scans' stamps: each scan's first time is taken for its stamp's",
                            field_.name));
  }

 private:
  /// Whole numbers of s and ms would be too coarse.
  [[nodiscard]] std::span<const Unit> units() const {
    return std::span(kUnits).subspan(is_whole(field_.type) ? 2 : 0);
  }
  [[nodiscard]] double span_s(const Unit& unit) const { return (most_ - least_) * unit.s; }
  [[nodiscard]] bool is_near_stamp(const Unit& unit) const {
    return std::max(std::abs(least_), std::abs(most_)) * unit.s <=
           static_cast<double>(kMaxTimeOffsetS);
  }
  /// Units differ by 1,000, sweeps by 12.5: there is one or none.
  [[nodiscard]] const Unit* unit_of_sweep() const {
    for (const Unit& unit : units())
      if (span_s(unit) >= kLeastSweepS && span_s(unit) <= kMostSweepS) return &unit;
    return nullptr;
  }
  /// Step of the numbers at this size.
  [[nodiscard]] double digits_s(const Unit& unit) const {
    if (field_.type != NumberType::kF32) return 0.0;
    const float most = static_cast<float>(std::abs(most_));
    return unit.s * (std::nextafter(most, std::numeric_limits<float>::infinity()) - most);
  }
  [[nodiscard]] std::string taken_as(const Unit& unit) const {
    return fmt::format(
        "the times of points in '{}' are taken as {}, since a sweep then takes {:.3f} s",
        field_.name, unit.name, span_s(unit));
  }

  [[nodiscard]] PointTimes from(double zero, const Unit& unit, std::string note) const {
    PointTimes times{{}, std::move(note)};
    times.offsets_s.reserve(values_.size());
    for (const double value : values_)
      times.offsets_s.push_back(static_cast<float>((value - zero) * unit.s));
    return times;
  }

  [[nodiscard]] bool is_near_stamps_clock(const Unit& unit) const {
    const auto near = [&](double value) {
      return std::abs(from_stamp_s(value, unit.s, *stamp_ns_)) <=
             static_cast<double>(kMaxTimeOffsetS);
    };
    return stamp_ns_ && digits_s(unit) <= kCoarsestS && near(least_) && near(most_);
  }

  [[nodiscard]] PointTimes from_stamp(const Unit& unit) const {
    PointTimes times;
    times.offsets_s.reserve(values_.size());
    for (const double value : values_)
      times.offsets_s.push_back(static_cast<float>(from_stamp_s(value, unit.s, *stamp_ns_)));
    return times;
  }

  [[nodiscard]] PointTimes left_out(const std::string& why) const {
    return {{}, fmt::format("the times of points in '{}' are left out: {}", field_.name, why)};
  }

  std::span<const double> values_;
  const PointField& field_;
  std::optional<std::int64_t> stamp_ns_;
  double least_ = 0.0;
  double most_ = 0.0;
};

}  // namespace

PointTimes read_point_times(std::span<const double> values, const PointField& field,
                            std::optional<std::int64_t> stamp_ns) {
  if (values.empty()) return {};
  if (!std::ranges::all_of(values, [](double t) { return std::isfinite(t); }))
    return {
        {},
        fmt::format("the times of points in '{}' are left out: some are not finite", field.name)};
  return Column(values, field, stamp_ns).read();
}

}  // namespace stillmap::maps

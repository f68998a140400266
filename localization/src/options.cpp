#include <stillmap/localization/options.hpp>

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <type_traits>

namespace stillmap::localization {
namespace {

constexpr std::array<std::string_view, 3> kPresets = {"vehicle", "indoor", "handheld"};

template <auto Group, auto Field>
OptionInfo option(std::string_view key, std::string_view unit, double least, double most) {
  using Number = std::remove_reference_t<decltype((LocalizationOptions{}.*Group).*Field)>;
  return {.key = key,
          .unit = unit,
          .least = least,
          .most = most,
          .whole = std::is_integral_v<Number>,
          .get =
              [](const LocalizationOptions& options) {
                return static_cast<double>((options.*Group).*Field);
              },
          .set = [](LocalizationOptions& options,
                    double value) { (options.*Group).*Field = static_cast<Number>(value); }};
}

std::vector<std::string> violations_of(const LocalizationOptions& options, std::string_view group) {
  std::vector<std::string> out;
  for (const OptionInfo& each : all_options()) {
    const double value = each.get(options);
    if (!each.key.starts_with(group) || (value >= each.least && value <= each.most)) continue;
    out.push_back(fmt::format("{}: found {:g}, expected {:g} to {:g}", each.key, value, each.least,
                              each.most));
  }
  return out;
}

}  // namespace

std::span<const OptionInfo> all_options() {
  using A = AlignerOptions;
  using V = VerdictOptions;
  using T = TrackerOptions;
  constexpr auto kA = &LocalizationOptions::aligner;
  constexpr auto kV = &LocalizationOptions::verdict;
  constexpr auto kT = &LocalizationOptions::tracker;
  static const std::array options = {
      option<kA, &A::search_radius_m>("aligner.search_radius_m", "m", 1.0, 30.0),
      option<kA, &A::search_yaw_rad>("aligner.search_yaw_rad", "rad", 0.05, std::numbers::pi),
      option<kA, &A::search_height_m>("aligner.search_height_m", "m", 0.0, 30.0),
      option<kA, &A::lost_radius_m>("aligner.lost_radius_m", "m", 0.0, 200.0),
      option<kA, &A::lost_yaw_rad>("aligner.lost_yaw_rad", "rad", 0.05, std::numbers::pi),
      option<kA, &A::max_candidates>("aligner.max_candidates", "", 1.0, 20.0),
      option<kA, &A::max_places>("aligner.max_places", "", 1.0, 50.0),
      option<kA, &A::own_vehicle_m>("aligner.own_vehicle_m", "m", 0.0, 20.0),
      option<kV, &V::min_standing_points>("verdict.min_standing_points", "points", 10.0, 1000.0),
      option<kV, &V::min_known_share>("verdict.min_known_share", "", 0.0, 1.0),
      option<kV, &V::lost_support>("verdict.lost_support", "", 0.0, 1.0),
      option<kV, &V::ok_support>("verdict.ok_support", "", 0.0, 1.0),
      option<kV, &V::ambiguous_share>("verdict.ambiguous_share", "", 0.5, 1.0),
      option<kV, &V::max_ok_deviation_m>("verdict.max_ok_deviation_m", "m", 0.01, 10.0),
      option<kV, &V::max_ok_deviation_rad>("verdict.max_ok_deviation_rad", "rad", 0.001, 1.0),
      option<kT, &T::acceleration_density>("tracker.acceleration_density", "m^2/s^3", 1e-4, 1e4),
      option<kT, &T::turn_acceleration_density>("tracker.turn_acceleration_density", "rad^2/s^3",
                                                1e-6, 1e2),
      option<kT, &T::unknown_speed_m_s>("tracker.unknown_speed_m_s", "m/s", 0.01, 1000.0),
      option<kT, &T::unknown_turn_rad_s>("tracker.unknown_turn_rad_s", "rad/s", 0.001, 100.0),
      option<kT, &T::max_coast_s>("tracker.max_coast_s", "s", 0.0, 60.0),
      option<kT, &T::max_drift_m>("tracker.max_drift_m", "m", 0.1, 100.0),
      option<kT, &T::max_contradictions>("tracker.max_contradictions", "", 1.0, 1000.0),
      option<kT, &T::wide_searches>("tracker.wide_searches", "scans", 0.0, 1000.0),
      option<kT, &T::agreeing_answers>("tracker.agreeing_answers", "", 1.0, 100.0),
      option<kT, &T::history_s>("tracker.history_s", "s", 0.0, 600.0),
  };
  return options;
}

std::vector<std::string> AlignerOptions::violations() const {
  return violations_of({.aligner = *this, .verdict = {}, .tracker = {}}, "aligner.");
}

std::vector<std::string> VerdictOptions::violations() const {
  return violations_of({.aligner = {}, .verdict = *this, .tracker = {}}, "verdict.");
}

std::vector<std::string> TrackerOptions::violations() const {
  return violations_of({.aligner = {}, .verdict = {}, .tracker = *this}, "tracker.");
}

std::vector<std::string> LocalizationOptions::violations() const {
  return violations_of(*this, "");
}

std::span<const std::string_view> preset_names() { return kPresets; }

LocalizationOptions preset(std::string_view name) {
  LocalizationOptions options;
  if (name == "vehicle") return options;
  if (name == "indoor") {
    options.aligner = {.search_radius_m = 3.0,
                       .search_yaw_rad = 0.6,
                       .search_height_m = 0.0,
                       .lost_radius_m = 10.0,
                       .lost_yaw_rad = std::numbers::pi,
                       .own_vehicle_m = 0.6};
    options.tracker.acceleration_density = 1.0;
    options.tracker.turn_acceleration_density = 1.0;
    options.tracker.unknown_speed_m_s = 2.0;
    options.tracker.unknown_turn_rad_s = 1.0;
    options.tracker.max_drift_m = 3.0;
    return options;
  }
  if (name == "handheld") {
    options.aligner.search_yaw_rad = 0.8;
    options.aligner.lost_yaw_rad = std::numbers::pi;
    options.tracker.turn_acceleration_density = 4.0;
    options.tracker.unknown_speed_m_s = 3.0;
    options.tracker.unknown_turn_rad_s = 2.0;
    return options;
  }
  throw std::invalid_argument(
      fmt::format("preset: found '{}', expected one of: {}", name, fmt::join(kPresets, ", ")));
}

}  // namespace stillmap::localization

#include "evaluation/localization/integrity.hpp"

#include "evaluation/localization/localization_metrics.hpp"
#include "evaluation/localization/resampling.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

constexpr std::array kAllAxes{Axis::kLongitudinal, Axis::kLateral, Axis::kYaw, Axis::kVertical};
constexpr std::array kAlertAxes{Axis::kLongitudinal, Axis::kLateral, Axis::kYaw};

bool is_any(const LocalizationQuery& /*query*/) { return true; }
bool is_ok(const LocalizationQuery& query) { return query.status == localization::PoseStatus::kOk; }

double horizontal_level_over_error(const LocalizationQuery& query) {
  return std::hypot(query.protection.longitudinal_m, query.protection.lateral_m) /
         query.error.head<2>().norm();
}

}  // namespace

double error_along(const LocalizationQuery& query, Axis axis) {
  switch (axis) {
    case Axis::kLongitudinal:
      return std::abs(query.error[0]);
    case Axis::kLateral:
      return std::abs(query.error[1]);
    case Axis::kYaw:
      return std::abs(query.error[5]);
    case Axis::kVertical:
      return std::abs(query.error[2]);
  }
  throw std::invalid_argument("Axis out of range");
}

double level_along(const LocalizationQuery& query, Axis axis) {
  switch (axis) {
    case Axis::kLongitudinal:
      return query.protection.longitudinal_m;
    case Axis::kLateral:
      return query.protection.lateral_m;
    case Axis::kYaw:
      return query.protection.yaw_rad;
    case Axis::kVertical:
      return query.protection.vertical_m;
  }
  throw std::invalid_argument("Axis out of range");
}

double alert_limit_of(Axis axis) {
  if (axis == Axis::kVertical) return std::numeric_limits<double>::infinity();
  return axis == Axis::kYaw ? kAlertLimitRad : kAlertLimitM;
}

// Written so that NaN counts against the answer.
bool is_misleading(const LocalizationQuery& query) {
  return is_ok(query) && !std::ranges::all_of(kAllAxes, [&](Axis axis) {
           return error_along(query, axis) <= level_along(query, axis);
         });
}

bool is_hazardous(const LocalizationQuery& query) {
  return is_ok(query) && std::ranges::any_of(kAlertAxes, [&](Axis axis) {
           return level_along(query, axis) <= alert_limit_of(axis) &&
                  !(error_along(query, axis) <= alert_limit_of(axis));
         });
}

bool is_available(const LocalizationQuery& query) {
  return is_ok(query) && std::ranges::all_of(kAlertAxes, [&](Axis axis) {
           return level_along(query, axis) <= alert_limit_of(axis);
         });
}

Integrity integrity_of(const std::vector<LocalizationQuery>& queries, std::uint64_t seed) {
  const auto is_unavailable = [](const LocalizationQuery& query) { return !is_available(query); };
  Integrity integrity;
  integrity.misleading = bounded_rate(counts_by_scan(queries, is_misleading, is_ok), seed);
  integrity.hazardous = bounded_rate(counts_by_scan(queries, is_hazardous, is_ok), seed);
  integrity.availability = bounded_rate(counts_by_scan(queries, is_available, is_any), seed);
  integrity.availability_lower_95 =
      1.0 - bounded_rate(counts_by_scan(queries, is_unavailable, is_any), seed).upper_95;
  std::vector<double> ratios;
  for (const LocalizationQuery& query : queries) {
    const double ratio = horizontal_level_over_error(query);
    // An infinite level stays in: it bounds nothing, and must not make the others look tight.
    if (is_ok(query) && !std::isnan(ratio)) ratios.push_back(ratio);
  }
  integrity.level_over_error = percentile(std::move(ratios), 0.5);
  return integrity;
}

}  // namespace stillmap::mapping

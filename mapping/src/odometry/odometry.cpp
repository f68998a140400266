#include <stillmap/mapping/odometry.hpp>

#include "odometry/direct/direct_odometry.hpp"
#include "odometry/loam/loam_odometry.hpp"

#include <fmt/format.h>

#include <array>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

struct NamedOdometry {
  std::string_view name;
  std::unique_ptr<Odometry> (*make)();
};
/// The default first.
constexpr std::array<NamedOdometry, 2> kMethods = {
    {{"default", make_direct_odometry}, {"loam", make_loam}}};

}  // namespace

std::string_view name_of(OdometryStatus status) {
  switch (status) {
    case OdometryStatus::kMatched:
      return "matched";
    case OdometryStatus::kPartly:
      return "partly";
    case OdometryStatus::kPredicted:
      return "predicted";
  }
  throw std::invalid_argument(fmt::format("OdometryStatus: {}, unknown", static_cast<int>(status)));
}

std::vector<std::string> odometry_names() {
  std::vector<std::string> names;
  for (const NamedOdometry& method : kMethods) names.emplace_back(method.name);
  return names;
}

std::unique_ptr<Odometry> make_odometry(std::string_view method) {
  for (const NamedOdometry& named : kMethods) {
    if (named.name == method) return named.make();
  }
  throw std::invalid_argument(fmt::format("odometry: found '{}', expected one of: {}", method,
                                          fmt::join(odometry_names(), ", ")));
}

}  // namespace stillmap::mapping

#include <stillmap/localization/reason.hpp>

#include <algorithm>
#include <array>
#include <iterator>

namespace stillmap::localization {
namespace {

struct NamedReason {
  Reason reason;
  std::string_view name;
};
constexpr std::array kNames = {
    NamedReason{Reason::kTooFewPoints, "too_few_points"},
    NamedReason{Reason::kOutsideMap, "outside_map"},
    NamedReason{Reason::kNeedsPrior, "needs_prior"},
    NamedReason{Reason::kTooLittleStructure, "too_little_structure"},
    NamedReason{Reason::kLittleOverlap, "little_overlap"},
    NamedReason{Reason::kLowInlierRatio, "low_inlier_ratio"},
    NamedReason{Reason::kUnobservableDirection, "unobservable_direction"},
    NamedReason{Reason::kAmbiguous, "ambiguous"},
    NamedReason{Reason::kContradictsPrior, "contradicts_prior"},
    NamedReason{Reason::kNotDeskewed, "not_deskewed"},
    NamedReason{Reason::kLargeCovariance, "large_covariance"},
    NamedReason{Reason::kNotConverged, "not_converged"},
    NamedReason{Reason::kCoasting, "coasting"},
    NamedReason{Reason::kInterpolated, "interpolated"},
    NamedReason{Reason::kContradictsMotion, "contradicts_motion"},
    NamedReason{Reason::kUnconfirmed, "unconfirmed"},
    NamedReason{Reason::kNotTracked, "not_tracked"},
    NamedReason{Reason::kTooOld, "too_old"},
    NamedReason{Reason::kClockSetBack, "clock_set_back"},
};
constexpr bool in_order() {
  for (std::size_t i = 0; i < kNames.size(); ++i)
    if (static_cast<std::size_t>(kNames[i].reason) != i) return false;
  return true;
}
static_assert(in_order());

}  // namespace

std::string_view name_of(Reason reason) { return kNames.at(static_cast<std::size_t>(reason)).name; }

std::vector<std::string> names_of(const std::vector<Reason>& reasons) {
  std::vector<std::string> names;
  names.reserve(reasons.size());
  for (const Reason reason : reasons) names.emplace_back(name_of(reason));
  return names;
}

std::span<const Reason> all_reasons() {
  static constexpr auto kReasons = [] {
    std::array<Reason, kNames.size()> reasons{};
    std::transform(kNames.begin(), kNames.end(), reasons.begin(),
                   [](const NamedReason& each) { return each.reason; });
    return reasons;
  }();
  return kReasons;
}

}  // namespace stillmap::localization

#include "fusion/evidence.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

/// Most of what a detector without a network brings once is nothing.
constexpr double kPriorLogOdds = -1.0;
/// A good view without a box: detectors find nine of ten cars that are near and in plain sight.
constexpr double kMissLogOdds = -2.0;
/// Rays went right through it.
constexpr double kFreeLogOdds = -1.0;
/// What was not there at another time is no part of the street.
constexpr double kFreeElsewhenLogOdds = 2.0;
/// Rays that a detector can make a box of; a scan with fewer says nothing by finding none.
constexpr std::size_t kMinToMiss = 25;
/// Two scans are two opinions when the sensor went so far between them [m]; nearer ones repeat each
/// other.
constexpr double kNewViewM = 5.0;
constexpr double kSameView = 0.02;

}  // namespace

void Evidence::add_hit(double weight, double log_odds_of_box) {
  ++hits;
  log_odds += weight * log_odds_of_box;
}

void Evidence::add_silence(double weight, const PlaceLook& look) {
  if (look.state == PlaceState::kFree) {
    log_odds += kFreeLogOdds;
  } else if (look.on_body >= kMinToMiss) {
    ++missed;
    log_odds += weight * kMissLogOdds;
  }
}

double log_odds_of(double score) {
  const double p = std::clamp(score, 0.1, 0.95);
  return std::log(p / (1.0 - p));
}

double view_weight(double travel_m) { return std::clamp(travel_m / kNewViewM, kSameView, 1.0); }

double existence_of(const Evidence& evidence) {
  const double log_odds =
      kPriorLogOdds + evidence.log_odds + (evidence.free_elsewhen ? kFreeElsewhenLogOdds : 0.0);
  return 1.0 / (1.0 + std::exp(-log_odds));
}

}  // namespace stillmap::mapping

#include "odometry/loam/ring_order.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace stillmap::mapping::loam {
namespace {

constexpr double kTurnRad = 2.0 * std::numbers::pi;
constexpr double kDegree = std::numbers::pi / 180.0;
/// Steps within a ring are shorter than this unless nothing came back.
constexpr double kShortStepRad = 10.0 * kDegree;
/// Share of short steps that go forward where points are listed ring by ring; the rest are lasers
/// with azimuths of their own, noise, and the seam of a deskewed sweep.
constexpr double kMinForwardShare = 0.9;
/// Steps back of up to this much are such, longer ones a new turn.
constexpr double kMaxBackRad = 30.0 * kDegree;
/// Elevations of neighbouring rings differ by this much.
constexpr double kMinJumpRad = 0.1 * kDegree;
constexpr double kMaxJumpRad = 4.0 * kDegree;
constexpr std::size_t kBins = 72;
/// Rings start within this much of their common azimuth.
constexpr double kWindowRad = 12.0 * kDegree;
/// Points on either side whose elevations are compared at a boundary.
constexpr std::size_t kSide = 3;

/// +1 counter-clockwise, -1 clockwise, 0 when the order tells neither.
int direction_of(std::span<const float> azimuths) {
  std::size_t forward = 0;
  std::size_t back = 0;
  for (std::size_t i = 1; i < azimuths.size(); ++i) {
    const double step = azimuths[i] - azimuths[i - 1];
    if (std::abs(step) < kShortStepRad) ++(step >= 0.0 ? forward : back);
  }
  const auto least = kMinForwardShare * static_cast<double>(forward + back);
  if (static_cast<double>(forward) >= least) return 1;
  return static_cast<double>(back) >= least ? -1 : 0;
}

/// Azimuth that goes on from ring to ring.
std::vector<double> unwrapped(std::span<const float> azimuths, int direction) {
  std::vector<double> out(azimuths.size());
  out[0] = static_cast<double>(direction) * azimuths[0];
  for (std::size_t i = 1; i < azimuths.size(); ++i) {
    double step = std::fmod(static_cast<double>(direction) * azimuths[i] - out[i - 1], kTurnRad);
    if (step < -kMaxBackRad) step += kTurnRad;
    if (step >= kTurnRad - kMaxBackRad) step -= kTurnRad;
    out[i] = out[i - 1] + step;
  }
  return out;
}

/// The azimuth [rad] where elevations jump to one side most often.
double common_start(std::span<const double> turned, std::span<const float> elevations) {
  std::array<int, kBins> net{};
  for (std::size_t i = 1; i < turned.size(); ++i) {
    const double jump = elevations[i] - elevations[i - 1];
    if (!(std::abs(jump) > kMinJumpRad && std::abs(jump) < kMaxJumpRad)) continue;
    const double share = turned[i] / kTurnRad - std::floor(turned[i] / kTurnRad);
    net[std::min(kBins - 1, static_cast<std::size_t>(share * kBins))] += jump > 0.0 ? 1 : -1;
  }
  std::size_t best = 0;
  int most = -1;
  for (std::size_t b = 0; b < kBins; ++b) {
    const int sum = std::abs(net[b] + net[(b + 1) % kBins] + net[(b + kBins - 1) % kBins]);
    if (sum > most) {
      most = sum;
      best = b;
    }
  }
  return kTurnRad * (static_cast<double>(best) + 0.5) / static_cast<double>(kBins);
}

double mean_of(std::span<const float> values) {
  double sum = 0.0;
  for (const float v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

/// First point of the ring that starts near `azimuth`, among [first, end).
std::size_t boundary(std::span<const double> turned, std::span<const float> elevations,
                     double azimuth, std::size_t first) {
  std::size_t i = first;
  while (i < turned.size() && turned[i] < azimuth - kWindowRad) ++i;
  std::size_t best = i;
  double highest = -1.0;
  for (; i < turned.size() && turned[i] < azimuth + kWindowRad; ++i) {
    if (i == 0) continue;
    const std::size_t before = std::min(kSide, i);
    const std::size_t after = std::min(kSide, turned.size() - i);
    const double jump = std::abs(mean_of(elevations.subspan(i, after)) -
                                 mean_of(elevations.subspan(i - before, before)));
    const double off = std::abs(turned[i] - azimuth) / kWindowRad;
    if (jump * (1.0 - 0.5 * off) > highest) {
      highest = jump * (1.0 - 0.5 * off);
      best = i;
    }
  }
  return best;
}

}  // namespace

std::vector<std::uint32_t> ring_starts_by_order(std::span<const float> azimuths,
                                                std::span<const float> elevations) {
  const int direction = azimuths.size() < 2 ? 0 : direction_of(azimuths);
  if (direction == 0) return {};
  const std::vector<double> turned = unwrapped(azimuths, direction);
  const double start = common_start(turned, elevations);
  std::vector<std::uint32_t> starts{0};
  double turn = std::floor((turned.front() - start - kWindowRad) / kTurnRad) + 1.0;
  while (start + turn * kTurnRad < turned.front() + kWindowRad) ++turn;
  for (; start + turn * kTurnRad < turned.back() - kWindowRad; ++turn) {
    const std::size_t at = boundary(turned, elevations, start + turn * kTurnRad, starts.back());
    if (at > starts.back() && at < turned.size()) starts.push_back(static_cast<std::uint32_t>(at));
  }
  starts.push_back(static_cast<std::uint32_t>(turned.size()));
  return starts;
}

}  // namespace stillmap::mapping::loam

#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <numbers>

namespace stillmap::simulation {

/// Scrambles all 64 bits (splitmix64's finalizer; Steele, Lea, Flood, OOPSLA 2014).
[[nodiscard]] constexpr std::uint64_t scrambled(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15U;
  x = (x ^ (x >> 30U)) * 0xbf58476d1ce4e5b9U;
  x = (x ^ (x >> 27U)) * 0x94d049bb133111ebU;
  return x ^ (x >> 31U);
}

/// One key from several numbers; their order matters.
[[nodiscard]] constexpr std::uint64_t key_of(std::initializer_list<std::uint64_t> parts) {
  std::uint64_t key = 0;
  for (const std::uint64_t part : parts) key = scrambled(key ^ part);
  return key;
}

/// Random numbers that follow from a key alone, so that who asks first, or from which thread,
/// changes nothing. The standard library's distributions would differ from one implementation to
/// the next.
class Random {
 public:
  explicit Random(std::uint64_t key) : state_(key) {}

  [[nodiscard]] std::uint64_t bits() { return scrambled(state_++); }
  /// In [0, 1).
  [[nodiscard]] double uniform() { return static_cast<double>(bits() >> 11U) * 0x1p-53; }
  [[nodiscard]] double uniform(double low, double high) { return low + (high - low) * uniform(); }
  [[nodiscard]] bool chance(double probability) { return uniform() < probability; }
  /// In [0, count).
  [[nodiscard]] std::size_t index(std::size_t count) {
    return static_cast<std::size_t>(uniform() * static_cast<double>(count));
  }
  /// -1 or 1.
  [[nodiscard]] double sign() { return chance(0.5) ? 1.0 : -1.0; }
  /// Mean 0, standard deviation 1 (Box-Muller).
  [[nodiscard]] double normal() { return normal_pair()[0]; }
  /// Two of them for the price of one.
  [[nodiscard]] std::array<double, 2> normal_pair() {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
    const double angle = 2.0 * std::numbers::pi * uniform();
    return {radius * std::cos(angle), radius * std::sin(angle)};
  }

 private:
  std::uint64_t state_;
};

/// What a key is for, so that no two things share their numbers.
enum class Stream : std::uint64_t {
  kRoad = 1,
  kGround,
  kBuildings,
  kFurniture,
  kPlants,
  kParked,
  kTraffic,
  kWalkers,
  kBodies,
  kRays,
  kGnss,
};

[[nodiscard]] constexpr std::uint64_t key_of(std::uint64_t seed, Stream stream,
                                             std::uint64_t number = 0) {
  return key_of({seed, static_cast<std::uint64_t>(stream), number});
}

}  // namespace stillmap::simulation

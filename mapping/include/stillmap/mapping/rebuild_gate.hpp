#pragma once

#include <stillmap/mapping/map_consistency.hpp>

#include <cstddef>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// The figures by which a new map is judged. There is no truth: all figures compare it with the map
/// that keeps everything, and with the previous version. NaN: could not be measured; it passes no
/// limit except a least share of 0.
struct GateFigures {
  /// Held-back scans that were localized, in each map from the same priors.
  std::size_t queries = 0;
  /// Of these, found within 0.2 m and 1 deg.
  std::size_t found = 0;
  std::size_t found_in_keep = 0;
  /// Share of the keep map's static points that are far from every measured point of the new one.
  double static_loss = std::numeric_limits<double>::quiet_NaN();

  /// Against the version before.
  struct Previous {
    /// Scans that are `ok` in it, and how many of these are `lost` in the new map.
    std::size_t ok = 0;
    std::size_t new_lost = 0;
    /// Shares of its ground that the new map has too: within 2 m of its path, and within 15 m.
    double driven_coverage = std::numeric_limits<double>::quiet_NaN();
    double ground_coverage = std::numeric_limits<double>::quiet_NaN();
    /// How well the scans agree with each other, in it and in the new one, where both have points.
    MapConsistency consistency_before, consistency_now;
  };
  /// None for a first version.
  std::optional<Previous> previous;
};

/// What a figure may be at worst; a figure at its limit passes. Shares in [0, 1].
struct GateLimits {
  /// With fewer scans the gate does not pass.
  std::size_t least_queries = 20;
  /// If even the map that keeps everything finds fewer of the scans, they are of another place or
  /// frame, and the gate does not pass.
  double least_found_in_keep = 0.5;
  /// How much smaller the share of found scans may be than in the map that keeps everything.
  double found_below_keep = 0.01;
  std::size_t new_lost = 0;
  double static_loss = 0.02;
  double driven_coverage = 0.95;
  double ground_coverage = 0.85;
  /// How much thicker the median wall is, as a share of what it was, or of 2 cm, the noise of a
  /// sensor, where it was thinner.
  double wall_thickening = 0.25;
  /// How much higher the mean map entropy is [nat], in [0, 10].
  double entropy_rise = 0.2;
  /// Least share of found scans for a first version, which has no previous one to compare with.
  double first_found = 0.9;

  /// Every broken bound as "name: value, bound"; empty when usable.
  [[nodiscard]] std::vector<std::string> violations() const;
};

/// One rule of the gate and what came of it.
struct GateCheck {
  /// Name of the limit.
  std::string name;
  /// NaN: not measured.
  double found = 0.0;
  double limit = 0.0;
  bool passed = false;
  /// In words, whether it passed or not.
  std::string words;
};

struct GateVerdict {
  bool passed = false;
  std::vector<GateCheck> checks;
  /// Words of the checks that did not pass.
  std::vector<std::string> reasons;
};

/// @throws std::invalid_argument for limits out of bounds, or counts larger than what they are of.
[[nodiscard]] GateVerdict decide(const GateFigures& figures, const GateLimits& limits);

/// Limits out of a JSON object with any of the names above; what is left out stays as it is.
/// @throws maps::InputError naming the file and the key, also for one that is not known.
[[nodiscard]] GateLimits read_gate_limits(const std::filesystem::path& file);

}  // namespace stillmap::mapping

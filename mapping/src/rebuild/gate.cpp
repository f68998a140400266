#include <stillmap/mapping/rebuild_gate.hpp>

#include "core/share_of.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
/// Of what two versions have in common; fewer say nothing of how well their scans agree.
constexpr std::uint64_t kLeastCommonCells = 50;
/// Thinner walls are those of a sensor without noise.
constexpr double kThinWallM = 0.02;
constexpr const char* kWhatToDo =
    "; check the poses of the new drives (`given_poses` in the report says how far they are off)";
constexpr const char* kHoldBackMore =
    "; hold back more: --held-back DRIVE, a smaller --held-back-every, or a longer drive";
/// 0.98 is not 0.99 - 0.01 in doubles.
constexpr double kRounding = 1e-9;

std::string percent(double value) {
  return value == value ? fmt::format("{:.4g} %", 100.0 * value) : "not measured";
}

/// Comparisons are written so that NaN fails.
class Checks {
 public:
  void at_most(const std::string& name, double found, double limit, const std::string& what) {
    add({name, found, limit, found <= limit + kRounding,
         fmt::format("{}: {}, at most {}", what, percent(found), percent(limit))});
  }
  void at_least(const std::string& name, double found, double limit, const std::string& what) {
    // A limit of 0 asks for nothing.
    add({name, found, limit, limit == 0.0 || found >= limit - kRounding,
         fmt::format("{}: {}, at least {}", what, percent(found), percent(limit))});
  }
  void count_at_most(const std::string& name, std::size_t found, std::size_t limit,
                     const std::string& what) {
    add({name, static_cast<double>(found), static_cast<double>(limit), found <= limit,
         fmt::format("{}: {}, at most {}", what, found, limit)});
  }
  void enough_queries(std::size_t found, std::size_t limit) {
    const bool passed = found >= limit;
    add({"least_queries", static_cast<double>(found), static_cast<double>(limit), passed,
         fmt::format("held-back scans to judge by: {}, at least {}{}", found, limit,
                     passed ? "" : kHoldBackMore)});
  }
  /// Of what two versions have in common.
  /// @param cells  in common; of too few nothing is asked.
  void no_more_than(const std::string& name, std::uint64_t cells, double found, double limit,
                    const std::string& what) {
    if (cells < kLeastCommonCells) {
      add({name, kNone, limit, true,
           fmt::format("{} cells are in both versions, too few to compare them (at least {})",
                       cells, kLeastCommonCells)});
      return;
    }
    const bool passed = found <= limit + kRounding;
    add({name, found, limit, passed, passed ? what : what + kWhatToDo});
  }
  GateVerdict verdict() && {
    verdict_.passed = verdict_.reasons.empty();
    return std::move(verdict_);
  }

 private:
  void add(GateCheck check) {
    if (!check.passed) verdict_.reasons.push_back(check.words);
    verdict_.checks.push_back(std::move(check));
  }
  GateVerdict verdict_;
};

void check_consistency(const GateFigures::Previous& previous, const GateLimits& limits,
                       Checks& checks) {
  const MapConsistency& before = previous.consistency_before;
  const MapConsistency& now = previous.consistency_now;
  const double was_m = before.walls.median_m, is_m = now.walls.median_m;
  const double thickening = (is_m - was_m) / std::max(was_m, kThinWallM);
  checks.no_more_than("wall_thickening", now.walls.planar_cells, thickening, limits.wall_thickening,
                      fmt::format("walls are {:.1f} cm thick, {:.1f} cm in the previous version: "
                                  "{} thicker, at most {}",
                                  100.0 * is_m, 100.0 * was_m, percent(thickening),
                                  percent(limits.wall_thickening)));
  const double rise = now.mean_map_entropy - before.mean_map_entropy;
  checks.no_more_than(
      "entropy_rise", now.entropy_points, rise, limits.entropy_rise,
      fmt::format("mean map entropy is {:.2f} nat, {:.2f} nat in the previous version: higher by "
                  "{:.2f}, at most {:.4g}",
                  now.mean_map_entropy, before.mean_map_entropy, rise, limits.entropy_rise));
}

void require_counts(const GateFigures& figures) {
  const auto require = [](const char* name, std::size_t part, std::size_t whole) {
    if (part > whole)
      throw std::invalid_argument(fmt::format("{}: {}, expected at most {}", name, part, whole));
  };
  require("found", figures.found, figures.queries);
  require("found_in_keep", figures.found_in_keep, figures.queries);
  if (!figures.previous) return;
  require("previous.ok", figures.previous->ok, figures.queries);
  require("previous.new_lost", figures.previous->new_lost, figures.previous->ok);
}

}  // namespace

std::vector<std::string> GateLimits::violations() const {
  std::vector<std::string> broken;
  const auto check = [&](const char* name, double value) {
    if (!(value >= 0.0 && value <= 1.0))
      broken.push_back(fmt::format("{}: {}, expected in [0, 1]", name, value));
  };
  check("least_found_in_keep", least_found_in_keep);
  check("found_below_keep", found_below_keep);
  check("static_loss", static_loss);
  check("driven_coverage", driven_coverage);
  check("ground_coverage", ground_coverage);
  check("first_found", first_found);
  check("wall_thickening", wall_thickening);
  if (!(entropy_rise >= 0.0 && entropy_rise <= 10.0))
    broken.push_back(fmt::format("entropy_rise: {}, expected in [0, 10]", entropy_rise));
  if (least_queries < 1) broken.emplace_back("least_queries: 0, expected at least 1");
  return broken;
}

GateVerdict decide(const GateFigures& figures, const GateLimits& limits) {
  if (const auto broken = limits.violations(); !broken.empty())
    throw std::invalid_argument("gate limits: " + broken.front());
  require_counts(figures);
  const double found = share_of(figures.found, figures.queries);
  const double in_keep = share_of(figures.found_in_keep, figures.queries);
  Checks checks;
  checks.enough_queries(figures.queries, limits.least_queries);
  checks.at_least("least_found_in_keep", in_keep, limits.least_found_in_keep,
                  "held-back scans found in the map that keeps what can move");
  checks.at_most("found_below_keep", in_keep - found, limits.found_below_keep,
                 "held-back scans found less than in the map that keeps what can move");
  checks.at_most("static_loss", figures.static_loss, limits.static_loss, "static points lost");
  if (const auto& previous = figures.previous) {
    checks.count_at_most("new_lost", previous->new_lost, limits.new_lost,
                         "held-back scans lost that the previous version answers ok");
    checks.at_least("driven_coverage", previous->driven_coverage, limits.driven_coverage,
                    "the previous version's driven ground that is covered");
    checks.at_least("ground_coverage", previous->ground_coverage, limits.ground_coverage,
                    "the previous version's ground near its path that is covered");
    check_consistency(*previous, limits, checks);
  } else {
    checks.at_least("first_found", found, limits.first_found,
                    "held-back scans found in a first version");
  }
  return std::move(checks).verdict();
}

}  // namespace stillmap::mapping

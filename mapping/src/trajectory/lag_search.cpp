#include "trajectory/lag_search.hpp"

#include <stillmap/maps/frames.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <unordered_map>
#include <utility>
#include <vector>

namespace stillmap::mapping {
namespace {

constexpr double kMostLagS = 120.0;
/// Another lag counts where the logarithm of its likelihood is larger by this, in all and for each
/// independent stretch; and larger than everywhere else.
constexpr double kLagGain = 10.0;
constexpr double kLagGainEach = 0.35;
constexpr double kLagUnlikeOthers = 5.0;
/// What a length and a turn over a motion may differ by for other reasons [m, rad].
constexpr double kFloorM = 0.02;
constexpr double kFloorRad = 2e-3;

/// A motion's length and angle.
struct Amount {
  double length_m = 0.0;
  double angle_rad = 0.0;
};

Amount amount_of(const Eigen::Isometry3d& T) {
  return {T.translation().norm(), maps::log_so3(T.linear()).norm()};
}

/// Mean log-likelihood of one path's amounts given the other's, where their noise is not known.
class LagScore {
 public:
  void add(const Amount& a, const Amount& b) {
    ++count_;
    const std::array<std::array<double, 2>, 2> values{
        {{a.length_m, b.length_m}, {a.angle_rad, b.angle_rad}}};
    for (std::size_t i = 0; i < 2; ++i) {
      const auto& [x, y] = values[i];
      const std::array<double, 5> terms{x, y, x * x, y * y, x * y};
      for (std::size_t k = 0; k < terms.size(); ++k) sums_[i][k] += terms[k];
    }
  }
  [[nodiscard]] std::size_t count() const { return count_; }
  [[nodiscard]] double value() const { return of(sums_[0], kFloorM) + of(sums_[1], kFloorRad); }

 private:
  [[nodiscard]] double of(const std::array<double, 5>& sums, double floor) const {
    const auto n = static_cast<double>(count_);
    const double xx = sums[2] / n - sums[0] * sums[0] / (n * n);
    const double yy = sums[3] / n - sums[1] * sums[1] / (n * n);
    const double xy = std::max(0.0, sums[4] / n - sums[0] * sums[1] / (n * n));
    const double unexplained = std::max(0.0, yy - (xx > 0.0 ? xy * xy / xx : 0.0));
    return -0.5 * std::log((unexplained + floor * floor) / (yy + floor * floor));
  }

  std::size_t count_ = 0;
  std::array<std::array<double, 5>, 2> sums_{};
};

class LagSearch {
 public:
  LagSearch(const PathMotions& motions, const SmoothPath& given, double step_s)
      : motions_(motions), path_(given), step_s_(step_s) {
    for (const PathMotion& motion : motions.all) of_scans_.push_back(amount_of(motion.T));
  }

  [[nodiscard]] double best_s() const {
    const auto most = static_cast<long>(kMostLagS / step_s_);
    struct Likely {
      double lag_s = 0.0, value = 0.0, independent = 0.0;
    };
    std::vector<Likely> likely;
    for (long lag = -most; lag <= most; ++lag) {
      const double lag_s = static_cast<double>(lag) * step_s_;
      const LagScore score = at(lag_s);
      if (3 * score.count() >= of_scans_.size() && score.count() >= kFewestMotions)
        likely.push_back({lag_s, score.value(), motions_.independent(score.count())});
    }
    const auto best_where = [&](const auto& takes) {
      Likely best;
      for (const Likely& each : likely)
        if (takes(each.lag_s) && each.value > best.value) best = each;
      return best;
    };
    const auto best = best_where([](double) { return true; });
    const auto near = best_where([](double lag_s) { return std::abs(lag_s) <= kNearLagS; });
    const auto other = best_where([&](double lag_s) {
      return std::abs(lag_s - best.lag_s) > motions_.length_s + motions_.box_s;
    });
    const double gain = best.value - near.value;
    const bool is_better = gain > kLagGainEach && best.independent * gain > kLagGain &&
                           best.independent * (best.value - other.value) > kLagUnlikeOthers;
    return is_better ? best.lag_s : 0.0;
  }

 private:
  [[nodiscard]] LagScore at(double lag_s) const {
    LagScore score;
    for (std::size_t i = 0; i < of_scans_.size(); ++i) {
      const auto& amount =
          given_at(std::lround((motions_.all[i].t_s + lag_s - path_.begin_s()) / step_s_));
      if (amount) score.add(of_scans_[i], *amount);
    }
    return score;
  }
  /// Of the given motion so many steps behind the begin of its path. Only those that are asked for
  /// are taken: a path may reach for years beyond the scans.
  [[nodiscard]] const std::optional<Amount>& given_at(long step) const {
    const auto [at, is_new] = given_.try_emplace(step);
    if (is_new) {
      const double t_s = path_.begin_s() + static_cast<double>(step) * step_s_;
      if (const auto T = path_.motion(t_s, t_s + motions_.length_s)) at->second = amount_of(*T);
    }
    return at->second;
  }

  const PathMotions& motions_;
  const SmoothPath& path_;
  double step_s_;
  mutable std::unordered_map<long, std::optional<Amount>> given_;
  std::vector<Amount> of_scans_;
};

}  // namespace

double best_lag_s(const PathMotions& motions, const SmoothPath& given, double step_s) {
  return LagSearch(motions, given, step_s).best_s();
}

}  // namespace stillmap::mapping

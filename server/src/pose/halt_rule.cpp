#include "pose/halt_rule.hpp"

#include <fmt/format.h>

#include <cmath>

namespace stillmap::server {
namespace {

struct Proportion {
  std::int64_t count = 0;
  /// 0: a share of 0 that is taken for certain.
  std::int64_t of = 0;
  [[nodiscard]] double share() const {
    return of == 0 ? 0.0 : static_cast<double>(count) / static_cast<double>(of);
  }
};

/// Of the difference of two proportions, with their common one when they are the same.
double z_of(const Proportion& a, const Proportion& b) {
  const double common = static_cast<double>(a.count + b.count) / static_cast<double>(a.of + b.of);
  const double variance =
      common * (1.0 - common) * (1.0 / static_cast<double>(a.of) + 1.0 / static_cast<double>(b.of));
  return (a.share() - b.share()) / std::sqrt(variance);
}

bool is_worse(const Proportion& group, const Proportion& others, const HaltOptions& options) {
  constexpr double kMostZ = 3.0;
  if (!(group.share() - others.share() > options.most_rise)) return false;
  return others.of == 0 || z_of(group, others) > kMostZ;
}

}  // namespace

void AnswerCounts::add(std::string_view status) {
  ++(status == "ok" ? ok : status == "degraded" ? degraded : lost);
}

std::string reason_to_halt(const RolloutFigures& figures, const HaltOptions& options) {
  const AnswerCounts& group = figures.rollout;
  if (group.all() < options.least_answers) return {};
  AnswerCounts others;
  std::string whose = "none is expected";
  if (figures.others.all() >= options.least_answers) {
    others = figures.others;
    whose = "of the others in the same time";
  } else if (figures.before.all() >= options.least_answers) {
    others = figures.before;
    whose = "of the active version before";
  }
  const auto told = [&](const char* what, const Proportion& a, const Proportion& b) {
    return fmt::format(
        "{} of the {} answers in the new version are {} ({:.1f} %), {}", a.count, a.of, what,
        100.0 * a.share(),
        b.of == 0 ? whose
                  : fmt::format("{} of {} {} ({:.1f} %)", b.count, b.of, whose, 100.0 * b.share()));
  };
  const Proportion lost{group.lost, group.all()};
  const Proportion others_lost{others.lost, others.all()};
  if (is_worse(lost, others_lost, options)) return told("lost", lost, others_lost);
  const Proportion bad{group.degraded + group.lost, group.all()};
  const Proportion others_bad{others.degraded + others.lost, others.all()};
  if (is_worse(bad, others_bad, options)) return told("degraded or lost", bad, others_bad);
  return {};
}

}  // namespace stillmap::server

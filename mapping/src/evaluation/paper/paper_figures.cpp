#include "evaluation/paper/paper_figures.hpp"

#include "evaluation/localization/resampling.hpp"
#include "evaluation/paper/street_draws.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string_view>
#include <utility>

namespace stillmap::mapping {
namespace {

using localization::PoseStatus;
using Weights = StreetDraws::Weights;

/// The draws of a table do not depend on its streets, so that tables of some of them compare.
constexpr std::uint64_t kSeed = 1;

/// Squared errors of all scans, streets one after the other.
struct Squares {
  std::vector<double> xy, yaw;
};

Squares squares_of(const PaperRow& row) {
  Squares squares;
  for (const PaperAnswers& street : row.streets) {
    for (const PaperAnswer& answer : street.scans) {
      squares.xy.push_back(answer.xy_m * answer.xy_m);
      squares.yaw.push_back(answer.yaw_rad * answer.yaw_rad);
    }
  }
  return squares;
}

double mean_of(const std::vector<double>& values, Weights weights) {
  double sum = 0.0, count = 0.0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    sum += weights[i] * values[i];
    count += weights[i];
  }
  return sum / count;
}

double root_mean(const std::vector<double>& squares, Weights weights) {
  return std::sqrt(mean_of(squares, weights));
}

Interval within(Interval interval, double least, double most) {
  interval.low = std::clamp(interval.low, least, most);
  interval.high = std::clamp(interval.high, least, most);
  return interval;
}

Interval root_mean_interval(const std::vector<double>& squares, const StreetDraws& draws) {
  return within(draws.interval([&](Weights weights) { return root_mean(squares, weights); }), 0.0,
                std::numeric_limits<double>::infinity());
}

/// What never failed in the scans at hand has not been seen to fail, no more: the lower bound is
/// at most the binomial one of as many queries as there are blocks.
Interval success_interval(const PaperRow& row, const StreetDraws& draws) {
  std::vector<double> successes;
  for (const PaperAnswers& street : row.streets) {
    for (const PaperAnswer& answer : street.scans) successes.push_back(answer.success ? 1.0 : 0.0);
  }
  Interval rate = within(
      draws.interval([&](Weights weights) { return mean_of(successes, weights); }), 0.0, 1.0);
  const auto blocks = static_cast<double>(draws.blocks());
  const auto failed = static_cast<std::size_t>(std::ceil((1.0 - rate.value) * blocks - 1e-9));
  rate.low = std::min(rate.low, 1.0 - binomial_upper_95(failed, draws.blocks()));
  return rate;
}

std::vector<std::size_t> scans_of(const PaperAnswers& street) {
  std::vector<std::size_t> scans;
  for (const PaperAnswer& answer : street.scans) scans.push_back(answer.scan);
  return scans;
}

/// Differences mean something only between answers to the same questions.
void require_same_scans(const std::vector<PaperRow>& rows) {
  for (const PaperRow& row : rows) {
    bool same = row.streets.size() == rows.front().streets.size();
    for (std::size_t i = 0; same && i < row.streets.size(); ++i)
      same = scans_of(row.streets[i]) == scans_of(rows.front().streets[i]);
    if (!same) throw std::invalid_argument("paper table: rows were asked with different scans");
  }
}

void count_and_answered(PaperRow& row) {
  double xy = 0.0, yaw = 0.0;
  row.queries = row.degraded = row.lost = 0;
  for (const PaperAnswers& street : row.streets) {
    for (const PaperAnswer& answer : street.scans) {
      ++row.queries;
      if (answer.status == PoseStatus::kDegraded) ++row.degraded;
      if (answer.status == PoseStatus::kLost) {
        ++row.lost;
        continue;
      }
      xy += answer.xy_m * answer.xy_m;
      yaw += answer.yaw_rad * answer.yaw_rad;
    }
  }
  const auto answered = static_cast<double>(row.queries - row.lost);
  // 0 / 0 is NaN: no figure.
  row.answered_rmse_xy_m = std::sqrt(xy / answered);
  row.answered_rmse_yaw_rad = std::sqrt(yaw / answered);
}

std::size_t better_streets(const PaperRow& row, const PaperRow& against,
                           double (*figure)(const PaperAnswers&)) {
  std::size_t better = 0;
  for (std::size_t i = 0; i < row.streets.size(); ++i)
    if (figure(row.streets[i]) < figure(against.streets[i])) ++better;
  return better;
}

PaperDifference difference_of(const PaperRow& row, const PaperRow& against,
                              const StreetDraws& draws) {
  const Squares a = squares_of(row);
  const Squares b = squares_of(against);
  const auto interval = [&](const std::vector<double>& x, const std::vector<double>& y) {
    return draws.interval(
        [&](Weights weights) { return root_mean(x, weights) - root_mean(y, weights); });
  };
  PaperDifference out;
  out.method = row.method;
  out.query = row.query;
  out.map = row.map;
  out.against = against.map;
  out.rmse_xy_m = interval(a.xy, b.xy);
  out.rmse_yaw_rad = interval(a.yaw, b.yaw);
  out.better_xy = better_streets(row, against, street_rmse_xy_m);
  out.better_yaw = better_streets(row, against, street_rmse_yaw_rad);
  out.streets = row.streets.size();
  return out;
}

void add_differences(PaperEvaluation& evaluation, const StreetDraws& draws) {
  const std::array<std::pair<const char*, const char*>, 2> projections{
      {{"paper", "deletion"}, {"ours-all", "ours"}}};
  const auto find = [&](const PaperRow& like, std::string_view map) -> const PaperRow* {
    for (const PaperRow& row : evaluation.rows) {
      if (row.method == like.method && row.query == like.query && row.map == map) return &row;
    }
    return nullptr;
  };
  evaluation.differences.clear();
  for (const PaperRow& row : evaluation.rows) {
    const PaperRow* const none = find(row, "none");
    if (none != nullptr && none != &row)
      evaluation.differences.push_back(difference_of(row, *none, draws));
  }
  for (const auto& [map, against] : projections) {
    for (const PaperRow& row : evaluation.rows) {
      const PaperRow* const other = find(row, against);
      if (row.map == map && other != nullptr)
        evaluation.differences.push_back(difference_of(row, *other, draws));
    }
  }
}

double street_rmse(const PaperAnswers& street, double PaperAnswer::*error) {
  double sum = 0.0;
  for (const PaperAnswer& answer : street.scans) sum += answer.*error * (answer.*error);
  return std::sqrt(sum / static_cast<double>(street.scans.size()));
}

}  // namespace

double street_rmse_xy_m(const PaperAnswers& street) {
  return street_rmse(street, &PaperAnswer::xy_m);
}

double street_rmse_yaw_rad(const PaperAnswers& street) {
  return street_rmse(street, &PaperAnswer::yaw_rad);
}

void judge(PaperEvaluation& evaluation) {
  if (evaluation.rows.empty()) throw std::invalid_argument("paper table: no rows");
  require_same_scans(evaluation.rows);
  std::vector<std::size_t> sizes;
  evaluation.scans = 0;
  for (const PaperAnswers& street : evaluation.rows.front().streets) {
    sizes.push_back(street.scans.size());
    evaluation.scans += street.scans.size();
  }
  const StreetDraws draws(sizes, kSeed);
  for (PaperRow& row : evaluation.rows) {
    const Squares squares = squares_of(row);
    count_and_answered(row);
    row.rmse_xy_m = root_mean_interval(squares.xy, draws);
    row.rmse_yaw_rad = root_mean_interval(squares.yaw, draws);
    row.success_rate = success_interval(row, draws);
  }
  add_differences(evaluation, draws);
}

}  // namespace stillmap::mapping

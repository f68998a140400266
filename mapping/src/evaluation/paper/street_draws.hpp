#pragma once

#include <stillmap/mapping/paper_evaluation.hpp>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// What a 95 % point of a normal distribution, 1.960, is to be stretched by when the deviation was
/// found by drawing `clusters` clusters from as many: sqrt(n / (n - 1)), because they scatter less
/// than what they stand for, and Student's t with n - 1 degrees of freedom, because n of them do
/// not know their deviation well. 2.7 for three. @param clusters  >= 2. @throws
/// std::invalid_argument.
[[nodiscard]] double stretch_of(std::size_t clusters);

/// Streets and their scans drawn again, to see by how much a figure could have come out otherwise.
///
/// Scans a second apart see the same cars and walls, so their errors are not independent pieces of
/// evidence: each of 2,000 draws takes as many streets as there are, with replacement, and in each
/// of them blocks of 10 scans in a row that begin anywhere (the last goes on at the first), until
/// there are as many scans as the street has. An interval is the 2.5 and 97.5 % points of the
/// figure over the draws, stretched about the figure itself by `stretch_of` the streets. It speaks
/// of streets like these, and few streets give wide ones. With one street it speaks of that street
/// alone, with its blocks in place of streets.
/// On synthetic errors that neighbours share, 95 to 100 % of the intervals of three streets hold
/// the truth where streets are alike, 98 % where their deviations scatter by a fifth, 87 % by half.
///
/// Same sizes and seed, same draws: figures of several maps that were asked with the same scans
/// are compared draw by draw, and what is hard for all of them cancels.
/// @see Kuensch, "The jackknife and the bootstrap for general stationary observations", Ann. Stat.
/// 17 (1989), blocks; Politis, Romano (1992), their circle; Davison, Hinkley, "Bootstrap methods"
/// (1997), section 3.8, streets and then scans; Cameron, Gelbach, Miller, "Bootstrap-based
/// improvements for inference with clustered errors", Rev. Econ. Stat. 90 (2008), few clusters.
class StreetDraws {
 public:
  static constexpr std::size_t kBlockScans = 10;
  static constexpr std::size_t kDraws = 2000;

  /// @param scans  of each street, >= 1; at least one street.
  /// @throws std::invalid_argument if not.
  StreetDraws(const std::vector<std::size_t>& scans, std::uint64_t seed);

  /// Of all streets.
  [[nodiscard]] std::size_t scans() const { return scans_; }
  /// Independent pieces of evidence: blocks of all streets.
  [[nodiscard]] std::size_t blocks() const { return blocks_; }

  /// How often each scan was drawn; streets one after the other.
  using Weights = std::span<const std::uint16_t>;
  /// @param figure  of all scans with such weights; of the scans as they are all weights are 1.
  /// @return the bounds are NaN with one street of one block, which tells of no deviation.
  [[nodiscard]] Interval interval(const std::function<double(Weights)>& figure) const;

 private:
  [[nodiscard]] Weights weights(std::size_t draw) const {
    return {weights_.data() + draw * scans_, scans_};
  }

  std::size_t scans_ = 0;
  std::size_t blocks_ = 0;
  double stretch_ = 1.0;
  std::vector<std::uint16_t> weights_;
};

}  // namespace stillmap::mapping

#include "detection/voxelnext/pruning.hpp"
#include "detection/voxelnext/rulebook.hpp"
#include "detection/voxelnext/sparse_convolution.hpp"
#include "support/voxelnext_weights.hpp"
#include "voxelnext_reference.hpp"

#include <gtest/gtest.h>
#include <hwy/targets.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <set>
#include <stdexcept>

namespace stillmap::test {
namespace voxelnext_layers_test {

using mapping::Convolution;
using mapping::FeatureRows;
using mapping::Rulebook;
using mapping::SiteSet;
using mapping::SparseConvolution;
using mapping::Triple;

Cell cell(const Triple& triple) { return {triple.z, triple.y, triple.x}; }

int volume(const Triple& kernel) { return kernel.z * kernel.y * kernel.x; }

void expect_near(const Layer& found, const Layer& expected) {
  ASSERT_EQ(cells_of(found), cells_of(expected));
  for (const auto& [at, row] : expected) {
    for (std::size_t c = 0; c < row.size(); ++c)
      ASSERT_NEAR(found.at(at)[c], row[c], 1e-4 * (1.0 + std::abs(row[c])))
          << "cell " << at[0] << " " << at[1] << " " << at[2] << " channel " << c;
  }
}

FeatureRows run(const SparseConvolution& layer, const Rulebook& book, const FeatureRows& in,
                bool relu) {
  FeatureRows out;
  out.reshape(book.out_rows(), layer.out_channels());
  layer.run(book, mapping::coded(in), out, {.relu = relu});
  return out;
}

TEST(SiteSet, NumbersActiveCellsAndKnowsTheOthers) {
  Random random(3);
  const SiteSet sites = random_sites(random, {3, 4, 150}, 0.2);
  ASSERT_GT(sites.size(), 100U);
  std::size_t found = 0;
  for (int z = -1; z <= 3; ++z) {
    for (int y = -1; y <= 4; ++y) {
      for (int x = -1; x <= 150; ++x) {
        const std::uint32_t number = sites.find({z, y, x});
        if (number == SiteSet::kNone) continue;
        ++found;
        EXPECT_EQ(sites[number], (Triple{z, y, x}));
      }
    }
  }
  EXPECT_EQ(found, sites.size());
}

TEST(SiteSet, RefusesGridsWithoutCellsOrWithTooMany) {
  EXPECT_THROW(SiteSet({0, 4, 4}), std::invalid_argument);
  EXPECT_THROW(SiteSet({41, 100'000, 100'000}), std::invalid_argument);
}

TEST(SubmanifoldConvolution, IsTheConvolutionAtActiveCells) {
  for (const Triple& kernel :
       {Triple{3, 3, 3}, Triple{1, 3, 3}, Triple{1, 1, 1}, Triple{5, 3, 1}}) {
    Random random(5);
    // Lines longer than a word of bits.
    const SiteSet sites = random_sites(random, {3, 5, 140}, 0.3);
    const Convolution layer = random_convolution(random, volume(kernel), 5, 7);
    const FeatureRows in = random_rows(random, sites.size(), 5);
    const FeatureRows out =
        run(SparseConvolution(layer), Rulebook::submanifold(sites, kernel), in, false);
    const Layer dense = layer_of(sites, in);
    expect_near(layer_of(sites, out),
                convolve(coded(dense), cells_of(dense), coded(layer), cell(kernel), {1, 1, 1}));
  }
}

TEST(SubmanifoldConvolution, AtSomeCellsIsTheSame) {
  Random random(6);
  const SiteSet sites = random_sites(random, {1, 12, 70}, 0.4);
  const SparseConvolution layer(random_convolution(random, 9, 24, 40));
  const FeatureRows in = random_rows(random, sites.size(), 24);
  const FeatureRows all = run(layer, Rulebook::submanifold(sites, {1, 3, 3}), in, true);
  std::vector<std::uint32_t> rows;
  for (std::uint32_t row = 0; row < sites.size(); row += 3) rows.push_back(row);
  const FeatureRows some = run(layer, Rulebook::submanifold_at(sites, {1, 3, 3}, rows), in, true);
  for (std::size_t k = 0; k < rows.size(); ++k) {
    EXPECT_EQ(std::memcmp(some.row(k), all.row(rows[k]), 40 * sizeof(float)), 0) << "row " << k;
  }
}

TEST(SparseConvolution, HoldsForAnyNumberOfChannels) {
  for (const auto& [in_channels, out_channels] : {std::pair{1, 1},
                                                  {6, 16},
                                                  {16, 17},
                                                  {3, 31},
                                                  {8, 33},
                                                  {32, 48},
                                                  {5, 64},
                                                  {9, 80},
                                                  {4, 130}}) {
    Random random(7);
    const SiteSet sites = random_sites(random, {2, 3, 20}, 0.5);
    const Convolution layer = random_convolution(random, 27, in_channels, out_channels);
    const FeatureRows in = random_rows(random, sites.size(), static_cast<std::size_t>(in_channels));
    const FeatureRows out =
        run(SparseConvolution(layer), Rulebook::submanifold(sites, {3, 3, 3}), in, true);
    const Layer dense = layer_of(sites, in);
    expect_near(layer_of(sites, out),
                relu(convolve(coded(dense), cells_of(dense), coded(layer), {3, 3, 3}, {1, 1, 1})));
    // Columns that only fill lines up stay 0.
    for (std::size_t c = out.channels(); c < out.stride(); ++c) EXPECT_EQ(out.row(0)[c], 0.0F);
  }
}

TEST(SparseConvolution, SideBySideIsOneAfterTheOther) {
  Random random(8);
  const SiteSet sites = random_sites(random, {1, 8, 40}, 0.5);
  const Convolution a = random_convolution(random, 9, 10, 12);
  const Convolution b = random_convolution(random, 9, 10, 70);
  const FeatureRows in = random_rows(random, sites.size(), 10);
  const Rulebook book = Rulebook::submanifold(sites, {1, 3, 3});
  const FeatureRows both = run(SparseConvolution({&a, &b}), book, in, false);
  const FeatureRows first = run(SparseConvolution(a), book, in, false);
  const FeatureRows second = run(SparseConvolution(b), book, in, false);
  for (std::size_t row = 0; row < sites.size(); ++row) {
    EXPECT_EQ(std::memcmp(both.row(row), first.row(row), 12 * sizeof(float)), 0);
    EXPECT_EQ(std::memcmp(both.row(row) + 12, second.row(row), 70 * sizeof(float)), 0);
  }
}

TEST(SparseConvolution, AddsToWhatIsThere) {
  Random random(9);
  const SiteSet sites = random_sites(random, {1, 8, 40}, 0.5);
  const Convolution layer = random_convolution(random, 9, 10, 10);
  const FeatureRows in = random_rows(random, sites.size(), 10);
  FeatureRows out = random_rows(random, sites.size(), 10);
  const Layer before = layer_of(sites, out), dense = layer_of(sites, in);
  SparseConvolution(layer).run(Rulebook::submanifold(sites, {1, 3, 3}), mapping::coded(in), out,
                               {.relu = true, .add_to_output = true});
  expect_near(layer_of(sites, out),
              relu(plus(convolve(coded(dense), cells_of(dense), coded(layer), {1, 3, 3}, {1, 1, 1}),
                        before)));
}

/// Some thousandths of what is usual: features in steps of 1/127 and weights of 1/63 of the
/// largest.
TEST(SparseConvolution, IsNearTheOneInFloats) {
  Random random(10);
  const SiteSet sites = random_sites(random, {3, 8, 60}, 0.4);
  const Convolution layer = random_convolution(random, 27, 64, 64);
  const FeatureRows in = random_rows(random, sites.size(), 64);
  const Layer found = layer_of(
      sites, run(SparseConvolution(layer), Rulebook::submanifold(sites, {3, 3, 3}), in, false));
  const Layer dense = layer_of(sites, in);
  double errors = 0.0, values = 0.0;
  for (const auto& [cell, row] : convolve(dense, cells_of(dense), layer, {3, 3, 3}, {1, 1, 1})) {
    for (std::size_t c = 0; c < row.size(); ++c) {
      errors += (row[c] - found.at(cell)[c]) * (row[c] - found.at(cell)[c]);
      values += row[c] * row[c];
    }
  }
  EXPECT_LT(std::sqrt(errors / values), 0.01);
  EXPECT_GT(errors, 0.0);
}

TEST(SparseConvolution, SaysThatRowsWithoutNumbersGiveNone) {
  Random random(10);
  const SiteSet sites = random_sites(random, {1, 1, 2}, 1.0);
  FeatureRows in = random_rows(random, 2, 8);
  const SparseConvolution layer(random_convolution(random, 1, 8, 8));
  for (const float bad :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    in.row(1)[3] = bad;
    const FeatureRows out = run(layer, Rulebook::identity(2), in, false);
    EXPECT_TRUE(std::isfinite(out.row(0)[0]));
    EXPECT_TRUE(std::isnan(out.row(1)[0]));
  }
}

TEST(SparseConvolution, RefusesShapesThatDoNotMeet) {
  Random random(9);
  Convolution layer = random_convolution(random, 9, 4, 4);
  const Convolution other = random_convolution(random, 9, 5, 4);
  EXPECT_THROW(SparseConvolution({&layer, &other}), std::invalid_argument);
  layer.weight.pop_back();
  EXPECT_THROW(SparseConvolution{layer}, std::invalid_argument);
}

/// Even and odd grids, kernels and channels of stages, and the neck's spreading one.
TEST(StridedConvolution, ReachesEveryCellWithAnInputUnderItsKernel) {
  struct Case {
    Triple grid, kernel, stride;
  };
  for (const Case& c :
       {Case{{5, 8, 131}, {3, 3, 3}, {2, 2, 2}}, Case{{4, 7, 130}, {3, 3, 3}, {2, 2, 2}},
        Case{{1, 1, 1}, {3, 3, 3}, {2, 2, 2}}, Case{{6, 9, 20}, {5, 5, 5}, {2, 2, 2}},
        Case{{1, 9, 66}, {1, 3, 3}, {1, 1, 1}}}) {
    Random random(11);
    const SiteSet sites = random_sites(random, c.grid, c.grid.x == 1 ? 1.0 : 0.05);
    const Convolution layer = random_convolution(random, volume(c.kernel), 4, 6);
    const FeatureRows in = random_rows(random, sites.size(), 4);
    const SiteSet reached = mapping::reached_by(sites, c.kernel, c.stride);
    const FeatureRows out = run(SparseConvolution(layer),
                                Rulebook::strided(sites, reached, c.kernel, c.stride), in, true);
    const Layer dense = layer_of(sites, in);
    const std::vector<Cell> cells =
        reached_cells(dense, cell(c.grid), cell(c.kernel), cell(c.stride));
    expect_near(layer_of(reached, out),
                relu(convolve(coded(dense), cells, coded(layer), cell(c.kernel), cell(c.stride))));
  }
}

std::set<Cell> not_dilating(const SiteSet& sites, const std::vector<std::uint8_t>& dilates) {
  std::set<Cell> out;
  for (std::size_t site = 0; site < sites.size(); ++site) {
    if (dilates[site] == 0) out.insert(cell(sites[site]));
  }
  return out;
}

/// Rows of which every third has the values of the one before.
FeatureRows rows_with_ties(Random& random, std::size_t rows, std::size_t channels) {
  FeatureRows out = random_rows(random, rows, channels);
  for (std::size_t row = 2; row < rows; row += 3)
    std::copy_n(out.row(row - 1), channels, out.row(row));
  return out;
}

TEST(Pruning, LeavesTheShareOfSmallestFeaturesOutAndOfEqualOnesTheLater) {
  for (const std::size_t channels : {1U, 16U, 37U}) {
    Random random(21);
    const SiteSet sites = random_sites(random, {3, 9, 80}, 0.2);
    const FeatureRows rows = rows_with_ties(random, sites.size(), channels);
    for (const double share : {0.0, 0.001, 0.3, 0.5, 0.99}) {
      EXPECT_EQ(not_dilating(sites, mapping::find_dilating(rows, share)),
                pruned_cells(layer_of(sites, rows), share))
          << channels << " channels, share " << share;
    }
  }
  FeatureRows equal(5, 3);
  EXPECT_EQ(mapping::find_dilating(equal, 0.5), (std::vector<std::uint8_t>{1, 1, 1, 0, 0}));
  // Size counts, not sign; and what fills a row up to whole lines does not.
  for (std::size_t row = 0; row < 5; ++row) equal.row(row)[2] = static_cast<float>(row) - 3.0F;
  for (std::size_t row = 0; row < 5; ++row) equal.row(row)[3] = row < 3 ? 0.0F : 100.0F;
  EXPECT_EQ(mapping::find_dilating(equal, 0.4), (std::vector<std::uint8_t>{1, 1, 1, 0, 0}));
}

TEST(Pruning, HoldsForFeaturesThatAreNoNumbersAndForNone) {
  FeatureRows rows(4, 2);
  rows.row(1)[0] = std::numeric_limits<float>::quiet_NaN();
  rows.row(2)[1] = -std::numeric_limits<float>::infinity();
  rows.row(3)[0] = 1.0F;
  EXPECT_EQ(mapping::find_dilating(rows, 0.5), (std::vector<std::uint8_t>{0, 1, 1, 0}));
  EXPECT_TRUE(mapping::find_dilating({}, 0.5).empty());
}

TEST(Pruning, RefusesSharesOutsideItsBounds) {
  const FeatureRows rows(3, 1);
  for (const double share : {-0.1, 1.0, std::numeric_limits<double>::quiet_NaN()})
    EXPECT_THROW(static_cast<void>(mapping::find_dilating(rows, share)), std::invalid_argument);
}

TEST(StridedConvolution, ReachesFromACellThatDoesNotDilateOnlyWhatLiesInItsMiddle) {
  struct Case {
    Triple grid, kernel;
    double share;
  };
  for (const Case& c : {Case{{5, 8, 131}, {3, 3, 3}, 0.5}, Case{{4, 7, 130}, {3, 3, 3}, 0.9},
                        Case{{6, 9, 20}, {5, 5, 5}, 0.5}, Case{{6, 9, 70}, {1, 1, 1}, 0.5},
                        Case{{5, 8, 131}, {3, 3, 3}, 0.0}}) {
    Random random(23);
    const Triple two{2, 2, 2};
    const SiteSet sites = random_sites(random, c.grid, 0.05);
    const Convolution layer = random_convolution(random, volume(c.kernel), 4, 6);
    const FeatureRows in = rows_with_ties(random, sites.size(), 4);
    const SiteSet reached =
        mapping::reached_by(sites, c.kernel, two, mapping::find_dilating(in, c.share));
    const FeatureRows out =
        run(SparseConvolution(layer), Rulebook::strided(sites, reached, c.kernel, two), in, true);
    const Layer dense = layer_of(sites, in);
    const std::vector<Cell> cells =
        reached_cells(dense, cell(c.grid), cell(c.kernel), cell(two), pruned_cells(dense, c.share));
    ASSERT_FALSE(cells.empty());
    // Features of all cells count, also of those that do not dilate.
    expect_near(layer_of(reached, out),
                relu(convolve(coded(dense), cells, coded(layer), cell(c.kernel), cell(two))));
  }
}

TEST(StridedConvolution, RefusesDilationOfOtherCells) {
  Random random(23);
  const SiteSet sites = random_sites(random, {4, 4, 4}, 0.5);
  const std::vector<std::uint8_t> few(sites.size() - 1, 1);
  EXPECT_THROW(static_cast<void>(mapping::reached_by(sites, {3, 3, 3}, {2, 2, 2}, few)),
               std::invalid_argument);
}

TEST(SparseConvolution, GivesTheSameBitsForAnyNumberOfThreads) {
  Random random(12);
  const SiteSet sites = random_sites(random, {4, 60, 200}, 0.1);
  const SparseConvolution layer(random_convolution(random, 27, 20, 50));
  const FeatureRows in = random_rows(random, sites.size(), 20);
  const auto on_threads = [&](int threads) {
    tbb::task_arena arena(threads);
    return arena.execute([&] {
      return run(layer, Rulebook::submanifold(sites, {3, 3, 3}), in, true);
    });
  };
  const FeatureRows one = on_threads(1), four = on_threads(4);
  EXPECT_EQ(std::memcmp(one.data(), four.data(), sites.size() * one.stride() * sizeof(float)), 0);
}

class InstructionSets : public testing::Test {
 protected:
  static void use(std::int64_t targets) {
    hwy::SetSupportedTargetsForTest(targets);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
  void TearDown() override { use(0); }
};

TEST_F(InstructionSets, GiveTheSameBits) {
  Random random(13);
  const SiteSet sites = random_sites(random, {4, 20, 100}, 0.3);
  const Rulebook book = Rulebook::submanifold(sites, {3, 3, 3});
  const Convolution layer = random_convolution(random, 27, 20, 50);
  const FeatureRows in = random_rows(random, sites.size(), 20);
  const FeatureRows best = run(SparseConvolution(layer), book, in, true);
  std::size_t sets = 0;
  for (std::int64_t left = hwy::SupportedTargets(); left != 0; left &= left - 1, ++sets) {
    use(left & -left);
    const FeatureRows out = run(SparseConvolution(layer), book, in, true);
    use(0);
    EXPECT_EQ(std::memcmp(out.data(), best.data(), sites.size() * out.stride() * sizeof(float)), 0)
        << hwy::TargetName(left & -left);
  }
  EXPECT_GE(sets, 2U);
}

TEST(SparseConvolution, ReadsTheLastColumnsOfRowsWhoseWidthIsNoWholeGroup) {
  Random random(14);
  const SiteSet sites = random_sites(random, {1, 4, 8}, 1.0);
  const FeatureRows in = random_rows(random, sites.size(), 80);
  const Convolution layer = random_convolution(random, 1, 20, 4);
  FeatureRows out;
  out.reshape(sites.size(), 4);
  const mapping::CodedRows rows = mapping::coded(in);
  SparseConvolution(layer).run(Rulebook::identity(sites.size()), {rows, 60}, out, {.relu = false});
  Layer last = coded(layer_of(sites, in));
  for (auto& [at, row] : last) row.erase(row.begin(), row.begin() + 60);
  expect_near(layer_of(sites, out),
              convolve(last, cells_of(last), coded(layer), {1, 1, 1}, {1, 1, 1}));
}

TEST(Rulebook, WorksWithoutAnyCell) {
  Random random(1);
  const SiteSet none = random_sites(random, {4, 8, 8}, 0.0);
  EXPECT_EQ(Rulebook::submanifold(none, {3, 3, 3}).pair_count(), 0U);
  const SiteSet reached = mapping::reached_by(none, {3, 3, 3}, {2, 2, 2});
  EXPECT_EQ(reached.size(), 0U);
  const FeatureRows out = run(SparseConvolution(random_convolution(random, 27, 4, 4)),
                              Rulebook::strided(none, reached, {3, 3, 3}, {2, 2, 2}), {}, true);
  EXPECT_EQ(out.rows(), 0U);
}

}  // namespace voxelnext_layers_test
}  // namespace stillmap::test

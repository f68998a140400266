#include "detection/voxelnext/network.hpp"

#include "detection/voxelnext/pruning.hpp"
#include "detection/voxelnext/rulebook.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <functional>
#include <iterator>
#include <stdexcept>
#include <string>
#include <utility>

namespace stillmap::mapping {

namespace {

constexpr Triple kCube{3, 3, 3};
constexpr Triple kSquare{1, 3, 3};
constexpr Triple kByOne{1, 1, 1};
constexpr Triple kByTwo{2, 2, 2};
/// Stages that are merged: 4, 5 and 6, counted from 0.
constexpr std::size_t kFirstMerged = 3;

template <typename F>
auto timed(Seconds& sum, F&& work) {
  const Stopwatch stopwatch(sum);
  return work();
}

void show(const NetworkObserver& observer, std::string_view layer, const SiteSet& sites,
          const FeatureRows& rows) {
  if (observer.layer) observer.layer(layer, sites, rows);
}

/// Takes a layer after checking its shape.
class LayerTaker {
 public:
  explicit LayerTaker(const VoxelNextWeights& weights) : weights_(weights) {}

  const Convolution* take(const std::string& name, const Triple& kernel, int in, int out) const {
    const Convolution& found = weights_.layer(name);
    const int volume = kernel.z * kernel.y * kernel.x;
    if (found.kernel_volume != volume || found.in_channels != in || found.out_channels != out) {
      throw std::invalid_argument(
          "voxelnext weights: layer '" + name + "': found " +
          shape(found.kernel_volume, found.in_channels, found.out_channels) + ", expected " +
          shape(volume, in, out));
    }
    return &found;
  }

 private:
  static std::string shape(int volume, int in, int out) {
    return std::to_string(volume) + " x " + std::to_string(in) + " x " + std::to_string(out);
  }
  const VoxelNextWeights& weights_;
};

/// What is positive, then what is negative, since convolutions take no signs.
FeatureRows by_sign(const FeatureRows& rows) {
  FeatureRows out(rows.rows(), 2 * rows.channels());
  for (std::size_t row = 0; row < rows.rows(); ++row) {
    for (std::size_t c = 0; c < rows.channels(); ++c) {
      const float value = rows.row(row)[c];
      out.row(row)[value < 0.0F ? rows.channels() + c : c] = std::abs(value);
    }
  }
  return out;
}

/// A convolution of features `by_sign`.
Convolution by_sign(const Convolution& of_signed) {
  Convolution out = of_signed;
  out.in_channels = 2 * of_signed.in_channels;
  out.weight.clear();
  const auto size = static_cast<std::ptrdiff_t>(of_signed.in_channels * of_signed.out_channels);
  for (auto at = of_signed.weight.begin(); at != of_signed.weight.end(); at += size) {
    out.weight.insert(out.weight.end(), at, at + size);
    std::transform(at, at + size, std::back_inserter(out.weight), std::negate<>());
  }
  return out;
}

/// @param is_first  its features have signs.
SparseConvolution opening_of(const Convolution& convolution, bool is_first) {
  return SparseConvolution(is_first ? by_sign(convolution) : convolution);
}

}  // namespace

Seconds Stopwatch::now() {
  timespec cpu{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &cpu);
  return {
      std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(),
      static_cast<double>(cpu.tv_sec) + 1e-9 * static_cast<double>(cpu.tv_nsec)};
}

VoxelNext::VoxelNext(const VoxelNextWeights& weights) : config_(weights.config) {
  check_pruning(config_.pruning);
  const LayerTaker layers(weights);
  int channels = static_cast<int>(config_.features.size());
  for (std::size_t i = 0; i < config_.stages.size(); ++i) {
    const VoxelNextStage& shape = config_.stages[i];
    const std::string name = "stage" + std::to_string(i + 1);
    const std::string opening = i == 0 ? "input" : name + ".down";
    const Triple kernel = i == 0 ? kCube : Triple{shape.kernel, shape.kernel, shape.kernel};
    Stage stage{kernel,
                opening_of(*layers.take(opening, kernel, channels, shape.channels), i == 0),
                {},
                opening,
                {}};
    channels = shape.channels;
    for (int j = 0; j < shape.blocks; ++j) {
      const std::string block = name + ".block" + std::to_string(j);
      const auto take = [&](const char* which) {
        return SparseConvolution(*layers.take(block + which, kCube, channels, channels));
      };
      stage.blocks.push_back({take(".conv1"), take(".conv2")});
      stage.block_names.push_back(block);
    }
    stages_.push_back(std::move(stage));
  }
  for (std::size_t i = kFirstMerged; i < config_.stages.size(); ++i) {
    if (config_.stages[i].channels != channels)
      throw std::invalid_argument("voxelnext config: stages 4, 5 and 6 differ in channels");
  }
  const int neck = config_.neck_channels;
  neck_.emplace_back(*layers.take("neck.out", kSquare, channels, neck));
  neck_.emplace_back(*layers.take("neck.shared", kSquare, neck, neck));

  const Triple head_kernel{1, config_.head_kernel, config_.head_kernel};
  std::vector<const Convolution*> heat_first;
  for (std::size_t h = 0; h < config_.heads.size(); ++h) {
    const std::string name = "head" + std::to_string(h) + ".";
    const std::size_t classes = config_.heads[h].classes.size();
    const auto first_of = [&](VoxelNextBranch branch) {
      return layers.take(name + std::string(name_of(branch)) + ".0", head_kernel, neck, neck);
    };
    const auto last_of = [&](VoxelNextBranch branch) {
      return SparseConvolution(*layers.take(name + std::string(name_of(branch)) + ".1", kByOne,
                                            neck, channels_of(branch, classes)));
    };
    heat_first.push_back(first_of(VoxelNextBranch::kHm));
    Head head{nullptr, {}, last_of(VoxelNextBranch::kHm), name};
    std::vector<const Convolution*> firsts;
    for (const VoxelNextBranch branch : config_.branches) {
      if (branch == VoxelNextBranch::kHm || branch == VoxelNextBranch::kVel) continue;
      firsts.push_back(first_of(branch));
      head.branches.push_back({branch, last_of(branch)});
    }
    if (!firsts.empty()) head.first = std::make_unique<SparseConvolution>(firsts);
    heads_.push_back(std::move(head));
  }
  if (!heat_first.empty()) heat_first_.emplace_back(heat_first);
}

void VoxelNext::run_blocks(const Stage& stage, Level& level, const Rulebook& book,
                           const NetworkObserver& observer, NetworkCosts::Part& cost) const {
  FeatureRows between;
  CodedRows coded_between;
  for (std::size_t j = 0; j < stage.blocks.size(); ++j) {
    const Block& block = stage.blocks[j];
    between.reshape(level.sites.size(), block.conv1.out_channels());
    {
      const Stopwatch stopwatch(cost.convolution);
      block.conv1.run(book, level.coded, between, {.relu = true, .coded = &coded_between});
      block.conv2.run(book, coded_between, level.rows,
                      {.relu = true, .add_to_output = true, .coded = &level.coded});
    }
    cost.multiplications += block.conv1.multiplications(book) + block.conv2.multiplications(book);
    show(observer, stage.block_names[j] + ".conv1", level.sites, between);
    show(observer, stage.block_names[j] + ".conv2", level.sites, level.rows);
  }
}

VoxelNext::Level VoxelNext::run_stage(std::size_t index, Level& before,
                                      const NetworkObserver& observer) const {
  const Stage& stage = stages_[index];
  NetworkCosts::Part unused;
  NetworkCosts::Part& cost = observer.cost_of("stage" + std::to_string(index + 1), unused);
  Level level;
  Rulebook opening, blocks;
  timed(cost.preparation, [&] {
    if (index > 0) {
      // Without pruning nobody needs to know the features' sizes.
      const double pruning = config_.pruning[index - 1];
      std::vector<std::uint8_t> dilates;
      if (pruning > 0.0) dilates = find_dilating(before.rows, pruning);
      level.sites = reached_by(before.sites, stage.kernel, kByTwo, dilates);
      opening = Rulebook::strided(before.sites, level.sites, stage.kernel, kByTwo);
    } else {
      level.sites = std::move(before.sites);
    }
    if (index == 0 || !stage.blocks.empty()) blocks = Rulebook::submanifold(level.sites, kCube);
  });
  const Rulebook& first = index == 0 ? blocks : opening;
  level.rows.reshape(level.sites.size(), stage.opening.out_channels());
  timed(cost.convolution, [&] {
    stage.opening.run(first, before.coded, level.rows, {.relu = true, .coded = &level.coded});
  });
  cost.multiplications += stage.opening.multiplications(first);
  cost.sites = level.sites.size();
  show(observer, stage.opening_name, level.sites, level.rows);
  run_blocks(stage, level, blocks, observer, cost);
  return level;
}

namespace {

struct Scaled {
  const SiteSet* sites;
  const FeatureRows* rows;
  int scale;
};

/// Puts sites of all levels onto the first one's grid seen from above and adds up what meets there
/// (equations 1 and 2 and "sparse height compression", section 3.1), in the order of levels and
/// sites. Cells that the scale puts outside the grid are left out: kernels of even size, which are
/// refused, could make such.
std::pair<SiteSet, FeatureRows> merge(const std::vector<Scaled>& levels) {
  const Triple& grid = levels.front().sites->grid();
  SiteSet cells({1, grid.y, grid.x});
  const auto cell_of = [](const Scaled& level, std::size_t site) {
    const Triple& at = (*level.sites)[site];
    return Triple{0, at.y * level.scale, at.x * level.scale};
  };
  for (const Scaled& level : levels) {
    for (std::size_t site = 0; site < level.sites->size(); ++site) {
      const Triple cell = cell_of(level, site);
      if (cells.contains(cell)) cells.mark(cell);
    }
  }
  cells.number_sites();
  const std::size_t channels = levels.front().rows->channels();
  FeatureRows sums(cells.size(), channels);
  for (const Scaled& level : levels) {
    for (std::size_t site = 0; site < level.sites->size(); ++site) {
      const std::uint32_t cell = cells.find(cell_of(level, site));
      if (cell == SiteSet::kNone) continue;
      float* to = sums.row(cell);
      const float* from = level.rows->row(site);
      for (std::size_t c = 0; c < channels; ++c) to[c] += from[c];
    }
  }
  return {std::move(cells), std::move(sums)};
}

}  // namespace

VoxelNext::Neck VoxelNext::backbone(Voxels voxels, const NetworkObserver& observer) const {
  Level level{std::move(voxels.sites), {}, coded(by_sign(voxels.features))};
  std::vector<Level> merged;
  for (std::size_t i = 0; i < stages_.size(); ++i) {
    Level next = run_stage(i, i > kFirstMerged ? merged.back() : level, observer);
    if (i >= kFirstMerged)
      merged.push_back(std::move(next));
    else
      level = std::move(next);
  }
  NetworkCosts::Part unused;
  NetworkCosts::Part& cost = observer.cost_of("neck", unused);
  const std::pair<SiteSet, FeatureRows> seen_from_above = timed(cost.preparation, [&] {
    return merge({{&merged[0].sites, &merged[0].rows, 1},
                  {&merged[1].sites, &merged[1].rows, 2},
                  {&merged[2].sites, &merged[2].rows, 4}});
  });
  const SiteSet& cells = seen_from_above.first;
  const FeatureRows& sums = seen_from_above.second;
  show(observer, "merge", cells, sums);
  Neck neck;
  const Rulebook spread = timed(cost.preparation, [&] {
    neck.cells = reached_by(cells, kSquare, kByOne);
    return Rulebook::strided(cells, neck.cells, kSquare, kByOne);
  });
  const Rulebook same =
      timed(cost.preparation, [&] { return Rulebook::submanifold(neck.cells, kSquare); });
  FeatureRows between;
  between.reshape(neck.cells.size(), neck_[0].out_channels());
  neck.features.reshape(neck.cells.size(), neck_[1].out_channels());
  CodedRows coded_between;
  timed(cost.convolution, [&] {
    neck_[0].run(spread, coded(sums), between, {.relu = true, .coded = &coded_between});
  });
  show(observer, "neck.out", neck.cells, between);
  timed(cost.convolution, [&] {
    neck_[1].run(same, coded_between, neck.features, {.relu = true, .coded = &neck.coded});
  });
  show(observer, "neck.shared", neck.cells, neck.features);
  cost.multiplications += neck_[0].multiplications(spread) + neck_[1].multiplications(same);
  cost.sites = neck.cells.size();
  return neck;
}

std::vector<HeadMaps> VoxelNext::heat_maps(const Neck& neck,
                                           const NetworkObserver& observer) const {
  std::vector<HeadMaps> out(heads_.size());
  if (heads_.empty()) return out;
  NetworkCosts::Part unused;
  NetworkCosts::Part& cost = observer.cost_of("hm", unused);
  const Triple kernel{1, config_.head_kernel, config_.head_kernel};
  const Rulebook book =
      timed(cost.preparation, [&] { return Rulebook::submanifold(neck.cells, kernel); });
  const Rulebook same = Rulebook::identity(neck.cells.size());
  const SparseConvolution& first = heat_first_.front();
  FeatureRows between;
  CodedRows coded_between;
  between.reshape(neck.cells.size(), first.out_channels());
  timed(cost.convolution,
        [&] { first.run(book, neck.coded, between, {.relu = true, .coded = &coded_between}); });
  cost.multiplications += first.multiplications(book);
  for (std::size_t h = 0; h < heads_.size(); ++h) {
    const SparseConvolution& last = heads_[h].heat;
    out[h].logits.reshape(neck.cells.size(), last.out_channels());
    timed(cost.convolution, [&] {
      last.run(same, {coded_between, h * neck.features.channels()}, out[h].logits, {.relu = false});
    });
    cost.multiplications += last.multiplications(same);
    show(observer, heads_[h].name + "hm.1", neck.cells, out[h].logits);
  }
  cost.sites = neck.cells.size();
  return out;
}

HeadBoxes VoxelNext::boxes(const Neck& neck, std::size_t head_index,
                           std::vector<std::uint32_t> cells,
                           const NetworkObserver& observer) const {
  const Head& head = heads_.at(head_index);
  HeadBoxes out;
  out.cells = std::move(cells);
  out.values.reshape(out.cells.size(), head.branches.size() * FeatureRows::kLine);
  if (out.cells.empty() || head.branches.empty()) return out;
  NetworkCosts::Part unused;
  NetworkCosts::Part& cost = observer.cost_of("boxes", unused);
  const Rulebook book = timed(cost.preparation, [&] {
    const Triple kernel{1, config_.head_kernel, config_.head_kernel};
    return Rulebook::submanifold_at(neck.cells, kernel, out.cells);
  });
  const Rulebook same = Rulebook::identity(out.cells.size());
  FeatureRows between;
  CodedRows coded_between;
  between.reshape(out.cells.size(), head.first->out_channels());
  timed(cost.convolution, [&] {
    head.first->run(book, neck.coded, between, {.relu = true, .coded = &coded_between});
  });
  cost.multiplications += head.first->multiplications(book);
  for (std::size_t b = 0; b < head.branches.size(); ++b) {
    const SparseConvolution& last = head.branches[b].last;
    const std::size_t column = b * FeatureRows::kLine;
    timed(cost.convolution, [&] {
      last.run(same, {coded_between, b * neck.features.channels()},
               {out.values.data() + column, out.values.stride()}, {.relu = false});
    });
    cost.multiplications += last.multiplications(same);
    out.column[head.branches[b].branch] = column;
  }
  cost.sites += out.cells.size();
  return out;
}

}  // namespace stillmap::mapping

#pragma once

#include "detection/voxelnext/feature_rows.hpp"
#include "detection/voxelnext/sites.hpp"
#include "detection/voxelnext/weights.hpp"
#include "support/synthetic_world.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

/// Sparse convolutions and VoxelNeXt once more, as their definitions say: cell by cell, in doubles.
namespace stillmap::test {

/// z, y, x.
using Cell = std::array<int, 3>;
using Layer = std::map<Cell, std::vector<double>>;

inline Cell cell_of(const mapping::Triple& at) { return {at.z, at.y, at.x}; }

inline Layer layer_of(const mapping::SiteSet& sites, const mapping::FeatureRows& rows) {
  Layer out;
  for (std::size_t site = 0; site < sites.size(); ++site) {
    const float* row = rows.row(site);
    out[cell_of(sites[site])] = std::vector<double>(row, row + rows.channels());
  }
  return out;
}

/// Output cells are given.
inline Layer convolve(const Layer& in, const std::vector<Cell>& out_cells,
                      const mapping::Convolution& layer, const Cell& kernel, const Cell& stride) {
  Layer out;
  for (const Cell& at : out_cells) {
    std::vector<double> sums(layer.bias.begin(), layer.bias.end());
    std::size_t k = 0;
    for (int dz = 0; dz < kernel[0]; ++dz) {
      for (int dy = 0; dy < kernel[1]; ++dy) {
        for (int dx = 0; dx < kernel[2]; ++dx, ++k) {
          const auto found = in.find({at[0] * stride[0] - kernel[0] / 2 + dz,
                                      at[1] * stride[1] - kernel[1] / 2 + dy,
                                      at[2] * stride[2] - kernel[2] / 2 + dx});
          if (found == in.end()) continue;
          for (std::size_t c = 0; c < found->second.size(); ++c) {
            for (std::size_t j = 0; j < sums.size(); ++j) {
              const std::size_t at_weight = (k * found->second.size() + c) * sums.size() + j;
              sums[j] += found->second[c] * static_cast<double>(layer.weight[at_weight]);
            }
          }
        }
      }
    }
    out[at] = sums;
  }
  return out;
}

/// Values as they are when their largest is `most` steps and all are whole steps: in floats, which
/// is part of the definition.
inline void round_to_steps(std::vector<double*> values, float most) {
  float largest = 0.0F;
  for (const double* value : values)
    largest = std::max(largest, std::abs(static_cast<float>(*value)));
  if (largest == 0.0F) return;
  for (double* value : values)
    *value = static_cast<double>(largest / most) *
             std::nearbyint(static_cast<double>(static_cast<float>(*value) * (most / largest)));
}

/// Rows as convolutions see them.
inline Layer coded(Layer layer) {
  for (auto& [cell, row] : layer) {
    std::vector<double*> values;
    for (double& value : row) values.push_back(&value);
    round_to_steps(values, 127.0F);
  }
  return layer;
}

/// Weights as convolutions have them.
inline mapping::Convolution coded(mapping::Convolution layer) {
  const auto channels = static_cast<std::size_t>(layer.out_channels);
  for (std::size_t j = 0; j < channels; ++j) {
    float largest = 0.0F;
    for (std::size_t i = j; i < layer.weight.size(); i += channels)
      largest = std::max(largest, std::abs(layer.weight[i]));
    const float step = largest / 63.0F;
    for (std::size_t i = j; i < layer.weight.size() && largest > 0.0F; i += channels)
      layer.weight[i] = step * std::nearbyint(layer.weight[i] / step);
  }
  return layer;
}

inline std::vector<Cell> cells_of(const Layer& layer) {
  std::vector<Cell> out;
  for (const auto& [cell, row] : layer) out.push_back(cell);
  return out;
}

/// The share of cells with the smallest mean of |feature|, by "y z x" descending where it is equal.
inline std::set<Cell> pruned_cells(const Layer& in, double share) {
  std::vector<std::pair<double, Cell>> order;
  for (const auto& [cell, row] : in) {
    double mean = 0.0;
    for (const double value : row) mean += std::abs(value) / static_cast<double>(row.size());
    order.push_back({mean, {-cell[1], -cell[0], -cell[2]}});
  }
  std::ranges::sort(order);
  std::set<Cell> out;
  for (std::size_t k = 0; k < static_cast<std::size_t>(share * static_cast<double>(in.size())); ++k)
    out.insert({-order[k].second[1], -order[k].second[0], -order[k].second[2]});
  return out;
}

/// Every cell of the output grid with an input cell under its kernel: any that is not pruned, or a
/// pruned one under its middle.
inline std::vector<Cell> reached_cells(const Layer& in, const Cell& grid, const Cell& kernel,
                                       const Cell& stride, const std::set<Cell>& pruned = {}) {
  std::vector<Cell> out;
  const auto size = [&](std::size_t a) {
    return (grid[a] + 2 * (kernel[a] / 2) - kernel[a]) / stride[a] + 1;
  };
  for (int z = 0; z < size(0); ++z) {
    for (int y = 0; y < size(1); ++y) {
      for (int x = 0; x < size(2); ++x) {
        const auto under = [&](int first, int n, int v) { return v >= first && v < first + n; };
        const bool reached = std::any_of(in.begin(), in.end(), [&](const auto& site) {
          const Cell& c = site.first;
          if (pruned.contains(c)) return Cell{z * stride[0], y * stride[1], x * stride[2]} == c;
          return under(z * stride[0] - kernel[0] / 2, kernel[0], c[0]) &&
                 under(y * stride[1] - kernel[1] / 2, kernel[1], c[1]) &&
                 under(x * stride[2] - kernel[2] / 2, kernel[2], c[2]);
        });
        if (reached) out.push_back({z, y, x});
      }
    }
  }
  return out;
}

inline Layer relu(Layer layer) {
  for (auto& [cell, row] : layer) {
    for (double& value : row) value = std::max(value, 0.0);
  }
  return layer;
}

inline Layer plus(Layer a, const Layer& b) {
  for (auto& [cell, row] : a) {
    for (std::size_t c = 0; c < row.size(); ++c) row[c] += b.at(cell)[c];
  }
  return a;
}

/// Adds a stage's cells, moved to stage 4's scale and put down onto z = 0.
inline void merge_onto(Layer& sum, const Layer& stage, int scale) {
  for (const auto& [cell, row] : stage) {
    std::vector<double>& to = sum[{0, cell[1] * scale, cell[2] * scale}];
    to.resize(row.size());
    for (std::size_t c = 0; c < row.size(); ++c) to[c] += row[c];
  }
}

/// The network once more, layer by layer.
class ReferenceNetwork {
 public:
  /// @param found  layers of the network under test: then convolutions are of bytes, each from what
  /// was found for the layer before, since a value at the border of two codes may take either.
  /// None: convolutions are of floats.
  explicit ReferenceNetwork(const mapping::VoxelNextWeights& weights,
                            const std::map<std::string, Layer>* found = nullptr)
      : weights_(weights), found_(found) {}

  /// Every layer by name, from the input voxels. @param grid  of the input.
  std::map<std::string, Layer> layers(const Layer& voxels, Cell grid) {
    constexpr Cell kCube{3, 3, 3}, kSquare{1, 3, 3};
    const mapping::VoxelNextConfig& config = weights_.config;
    Layer x = taken("input", relu(convolved(voxels, cells_of(voxels), "input", kCube)));
    Layer merged;
    Cell merged_grid{};
    for (std::size_t i = 0; i < 6; ++i) {
      const std::string stage = "stage" + std::to_string(i + 1);
      if (i > 0) {
        constexpr Cell kTwo{2, 2, 2};
        const int k = config.stages[i].kernel;
        const std::vector<Cell> cells =
            reached_cells(x, grid, {k, k, k}, kTwo, pruned_cells(x, config.pruning[i - 1]));
        const std::string name = stage + ".down";
        x = taken(name, relu(convolved(x, cells, name, {k, k, k}, kTwo)));
        for (int& n : grid) n = (n + 2 * (k / 2) - k) / 2 + 1;
      }
      for (int j = 0; j < config.stages[i].blocks; ++j) {
        const std::string block = stage + ".block" + std::to_string(j);
        const std::string first = block + ".conv1", second = block + ".conv2";
        const Layer y = taken(first, relu(convolved(x, cells_of(x), first, kCube)));
        x = taken(second, relu(plus(convolved(y, cells_of(y), second, kCube), x)));
      }
      if (i >= 3) merge_onto(merged, x, 1 << (i - 3));
      if (i == 3) merged_grid = {1, grid[1], grid[2]};
    }
    merged = taken("merge", merged);
    const std::vector<Cell> cells = reached_cells(merged, merged_grid, kSquare, kOne);
    x = taken("neck.out", relu(convolved(merged, cells, "neck.out", kSquare)));
    x = taken("neck.shared", relu(convolved(x, cells_of(x), "neck.shared", kSquare)));
    add_heads(x);
    return std::move(layers_);
  }

 private:
  static constexpr Cell kOne{1, 1, 1};
  using Branches = std::vector<std::pair<std::string, Layer>>;

  Layer convolved(const Layer& in, const std::vector<Cell>& cells, const std::string& layer,
                  const Cell& kernel, const Cell& stride = kOne) const {
    const mapping::Convolution& weights = weights_.layer(layer);
    return found_ == nullptr ? convolve(in, cells, weights, kernel, stride)
                             : convolve(coded(in), cells, coded(weights), kernel, stride);
  }

  /// What the next layer takes.
  Layer taken(const std::string& name, const Layer& layer) {
    layers_[name] = layer;
    return found_ == nullptr ? layer : found_->at(name);
  }

  void add_heads(const Layer& neck) {
    using mapping::VoxelNextBranch;
    const mapping::VoxelNextConfig& config = weights_.config;
    const Cell kernel{1, config.head_kernel, config.head_kernel};
    Branches heat;
    for (std::size_t h = 0; h < config.heads.size(); ++h) {
      Branches others;
      for (const VoxelNextBranch branch : config.branches) {
        if (branch == VoxelNextBranch::kVel) continue;
        const std::string name =
            "head" + std::to_string(h) + "." + std::string(mapping::name_of(branch));
        Branches& side_by_side = branch == VoxelNextBranch::kHm ? heat : others;
        side_by_side.emplace_back(name, relu(convolved(neck, cells_of(neck), name + ".0", kernel)));
      }
      add_last(std::move(others));
    }
    add_last(std::move(heat));
  }

  /// Last layers of branches. @param hidden  their first layers, whose rows share steps.
  void add_last(Branches hidden) {
    for (const auto& [cell, row] : hidden.front().second) {
      std::vector<double*> values;
      for (auto& [name, layer] : hidden) {
        for (double& value : layer.at(cell)) values.push_back(&value);
      }
      if (found_ != nullptr) round_to_steps(values, 127.0F);
    }
    for (const auto& [name, layer] : hidden) {
      const mapping::Convolution& weights = weights_.layer(name + ".1");
      layers_[name + ".1"] = convolve(layer, cells_of(layer),
                                      found_ != nullptr ? coded(weights) : weights, kOne, kOne);
    }
  }

  const mapping::VoxelNextWeights& weights_;
  const std::map<std::string, Layer>* found_;
  std::map<std::string, Layer> layers_;
};

/// Random active cells and features.
inline mapping::SiteSet random_sites(Random& random, const mapping::Triple& grid, double share) {
  mapping::SiteSet sites(grid);
  for (int z = 0; z < grid.z; ++z) {
    for (int y = 0; y < grid.y; ++y) {
      for (int x = 0; x < grid.x; ++x) {
        if (random.uniform() < share) sites.mark({z, y, x});
      }
    }
  }
  sites.number_sites();
  return sites;
}

/// Without negative values.
inline mapping::FeatureRows random_rows(Random& random, std::size_t rows, std::size_t channels) {
  mapping::FeatureRows out(rows, channels);
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t c = 0; c < channels; ++c)
      out.row(row)[c] = static_cast<float>(random.uniform(0.0, 1.0));
  }
  return out;
}

}  // namespace stillmap::test

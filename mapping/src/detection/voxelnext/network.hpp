#pragma once

#include "detection/voxelnext/feature_rows.hpp"
#include "detection/voxelnext/sites.hpp"
#include "detection/voxelnext/sparse_convolution.hpp"
#include "detection/voxelnext/voxels.hpp"
#include "detection/voxelnext/weights.hpp"

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// Time on the wall, and of the processor on all threads of the program together [s].
struct Seconds {
  double wall = 0.0;
  double cpu = 0.0;
};

/// Where one run spends its time, and on what.
struct NetworkCosts {
  struct Part {
    /// Voxels, rulebooks, merging.
    Seconds preparation;
    Seconds convolution;
    double multiplications = 0.0;
    std::size_t sites = 0;
  };
  /// By part: "voxels", "stage1" ..., "neck", "hm", "boxes".
  std::map<std::string, Part> parts;
};

/// Adds the time of its life to a sum.
class Stopwatch {
 public:
  explicit Stopwatch(Seconds& sum) : sum_(sum), start_(now()) {}
  Stopwatch(const Stopwatch&) = delete;
  Stopwatch& operator=(const Stopwatch&) = delete;
  ~Stopwatch() {
    const Seconds end = now();
    sum_.wall += end.wall - start_.wall;
    sum_.cpu += end.cpu - start_.cpu;
  }

 private:
  static Seconds now();

  Seconds& sum_;
  Seconds start_;
};

/// What a caller may want to see of a run; called in between, on the caller's thread.
struct NetworkObserver {
  /// Each layer's rows once they are final, after its ReLU: by the name of its convolution, that of
  /// the second convolution for a whole residual block, "merge" for the height compression.
  std::function<void(std::string_view layer, const SiteSet& sites, const FeatureRows& rows)> layer;
  NetworkCosts* costs = nullptr;

  /// @param unused  what is returned when nobody wants to know.
  [[nodiscard]] NetworkCosts::Part& cost_of(const std::string& part,
                                            NetworkCosts::Part& unused) const {
    return costs == nullptr ? unused : costs->parts[part];
  }
};

/// One head's answers in each cell of the map seen from above.
struct HeadMaps {
  /// Logits [cells][classes].
  FeatureRows logits;
};

/// Boxes of a head at some cells.
struct HeadBoxes {
  /// Cells, ascending.
  std::vector<std::uint32_t> cells;
  /// [cells][branch-wise lines]: the values of branch b begin at column `column.at(b)`.
  FeatureRows values;
  std::map<VoxelNextBranch, std::size_t> column;
};

/// VoxelNeXt (Chen, Liu, Zhang, Qi, Jia, "VoxelNeXt: Fully Sparse VoxelNet for 3D Object Detection
/// and Tracking", CVPR 2023) with six stages (section 3.1), sparse height compression (3.1) and a
/// sparse head (3.2), as their published program has it; with spatial voxel pruning (Fig. 5) where
/// the config asks for it, see pruning.hpp. Departures: what a head says besides the heat map is
/// computed only where the heat map asks for it, which changes no box.
class VoxelNext {
 public:
  /// @throws std::invalid_argument naming a layer that is missing or of the wrong shape, or for a
  /// pruning outside [0, 1).
  explicit VoxelNext(const VoxelNextWeights& weights);

  struct Neck {
    /// Cells of stage 4 seen from above, z = 0.
    SiteSet cells;
    FeatureRows features;
    CodedRows coded;
  };
  /// From voxels to the features that all heads share.
  [[nodiscard]] Neck backbone(Voxels voxels, const NetworkObserver& observer = {}) const;
  /// Heat maps of all heads.
  [[nodiscard]] std::vector<HeadMaps> heat_maps(const Neck& neck,
                                                const NetworkObserver& observer = {}) const;
  /// Everything else of a head. @param cells  numbers of cells of the neck, ascending.
  [[nodiscard]] HeadBoxes boxes(const Neck& neck, std::size_t head,
                                std::vector<std::uint32_t> cells,
                                const NetworkObserver& observer = {}) const;

 private:
  struct Block {
    SparseConvolution conv1;
    SparseConvolution conv2;
  };
  struct Stage {
    Triple kernel;
    /// The input convolution for stage 1.
    SparseConvolution opening;
    std::vector<Block> blocks;
    std::string opening_name;
    std::vector<std::string> block_names;
  };
  struct Branch {
    VoxelNextBranch branch;
    SparseConvolution last;
  };
  struct Head {
    /// First convolutions of all branches but the heat map, side by side; none without branches.
    std::unique_ptr<SparseConvolution> first;
    std::vector<Branch> branches;
    SparseConvolution heat;
    std::string name;
  };
  struct Level {
    SiteSet sites;
    FeatureRows rows;
    CodedRows coded;
  };

  void run_blocks(const Stage& stage, Level& level, const Rulebook& book,
                  const NetworkObserver& observer, NetworkCosts::Part& cost) const;
  /// @param before  the level below; stage 1 takes its sites over.
  [[nodiscard]] Level run_stage(std::size_t index, Level& before,
                                const NetworkObserver& observer) const;

  VoxelNextConfig config_;
  std::vector<Stage> stages_;
  std::vector<SparseConvolution> neck_;
  /// First convolutions of all heat maps, side by side.
  std::vector<SparseConvolution> heat_first_;
  std::vector<Head> heads_;
};

}  // namespace stillmap::mapping

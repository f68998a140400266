#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "detection/voxelnext/network.hpp"
#include "detection/voxelnext/safetensors.hpp"
#include "detection/voxelnext/weights.hpp"
#include "voxelnext_reference.hpp"

/// The network against a dense one in PyTorch with OpenPCDet's layers; see
/// tests/data/voxelnext/README.md.
namespace stillmap::mapping {
namespace voxelnext_openpcdet_test {

constexpr double kTolerance = 1e-4;
/// Of a layer's values, where ours are of bytes (decisions/features_are_bytes.md). The network is
/// so small and random that this shows.
constexpr double kToleranceOfBytes = 0.06;

using Cell = std::array<int, 3>;
using Rows = std::map<Cell, std::vector<float>>;

std::string file_named(const std::string& name) {
  return std::string(STILLMAP_TEST_DATA) + "/voxelnext/" + name;
}

/// layers.safetensors: rows of each layer by cell.
class Truth {
 public:
  Truth() {
    std::ifstream stream(file_named("layers.safetensors"), std::ios::binary);
    bytes_.assign(std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>());
    tensors_ = parse_safetensors(std::as_bytes(std::span(bytes_)), "layers.safetensors");
  }
  [[nodiscard]] std::set<std::string> layers() const {
    std::set<std::string> names;
    for (const auto& [name, view] : tensors_.tensors) {
      if (name.ends_with(".rows")) names.insert(name.substr(0, name.size() - 5));
    }
    return names;
  }
  [[nodiscard]] Rows rows(const std::string& layer) const {
    const TensorView& view = tensors_.tensors.at(layer + ".rows");
    const std::vector<float> values = view.floats();
    const std::vector<Cell> cells = cells_of(layer);
    EXPECT_EQ(view.shape.at(0), cells.size()) << layer;
    const auto width = static_cast<std::ptrdiff_t>(view.shape.at(1));
    Rows rows;
    auto row = values.begin();
    for (const Cell& cell : cells) {
      rows[cell] = std::vector<float>(row, row + width);
      row += width;
    }
    return rows;
  }

 private:
  /// Where a layer's cells are written: at the first layer that has them.
  static std::string keeper_of(const std::string& layer) {
    if (layer.starts_with("stage1.")) return "input";
    if (layer.starts_with("stage")) return layer.substr(0, 6) + ".down";
    if (layer.starts_with("head") || layer == "neck.shared") return "neck.out";
    return layer;
  }
  /// z y x; z = 0 in 2D.
  [[nodiscard]] std::vector<Cell> cells_of(const std::string& layer) const {
    const TensorView& view = tensors_.tensors.at(keeper_of(layer) + ".sites");
    const std::vector<float> places = view.floats();
    const std::size_t axes = view.shape.at(1);
    std::vector<Cell> cells(view.shape.at(0), Cell{});
    for (std::size_t i = 0; i < places.size(); ++i) {
      cells[i / axes][3 - axes + i % axes] = static_cast<int>(places[i]);
    }
    return cells;
  }

  std::string bytes_;
  Safetensors tensors_;
};

Rows rows_of(const SiteSet& sites, const FeatureRows& features) {
  Rows rows;
  for (std::size_t site = 0; site < sites.size(); ++site) {
    const float* row = features.row(site);
    rows[{sites[site].z, sites[site].y, sites[site].x}] =
        std::vector<float>(row, row + features.channels());
  }
  return rows;
}

/// Largest |a - b| / max(1, |b|); infinite where cells or channels differ, or a number is NaN.
double largest_difference(const test::Layer& found, const Rows& expected) {
  double largest = found.size() == expected.size() ? 0.0 : INFINITY;
  for (const auto& [cell, row] : expected) {
    const auto other = found.find(cell);
    if (other == found.end() || other->second.size() != row.size()) return INFINITY;
    for (std::size_t c = 0; c < row.size(); ++c) {
      const double b = row[c];
      const double difference = std::abs(other->second[c] - b) / std::max(1.0, std::abs(b));
      largest = std::isnan(difference) ? INFINITY : std::max(largest, difference);
    }
  }
  return largest;
}

/// |a - b| / |b| of all rows together; infinite where cells or channels differ, or a number is NaN.
double relative_difference(const Rows& found, const Rows& expected) {
  double differences = found.size() == expected.size() ? 0.0 : INFINITY, values = 0.0;
  for (const auto& [cell, row] : expected) {
    const auto other = found.find(cell);
    if (other == found.end() || other->second.size() != row.size()) return INFINITY;
    for (std::size_t c = 0; c < row.size(); ++c) {
      const double b = row[c], difference = other->second[c] - b;
      differences += std::isnan(difference) ? INFINITY : difference * difference;
      values += b * b;
    }
  }
  return std::sqrt(differences / values);
}

Voxels voxels_of(const Truth& truth, const VoxelNextConfig& config) {
  const Rows rows = truth.rows("voxels");
  Voxels voxels{SiteSet(voxel_grid(config)), FeatureRows(rows.size(), config.features.size())};
  for (const auto& [cell, row] : rows) voxels.sites.mark({cell[0], cell[1], cell[2]});
  voxels.sites.number_sites();
  for (const auto& [cell, row] : rows) {
    std::ranges::copy(row, voxels.features.row(voxels.sites.find({cell[0], cell[1], cell[2]})));
  }
  return voxels;
}

/// With `VoxelNextLayers`, where the program is the reference in bytes, this ties both to PyTorch.
TEST(VoxelNextOfOpenPcdet, ReferenceInFloatsGivesWhatPyTorchGivesInEveryLayer) {
  const VoxelNextWeights weights = read_voxelnext_weights(file_named("weights.safetensors"));
  const Truth truth;
  const Voxels voxels = voxels_of(truth, weights.config);
  const Triple grid = voxels.sites.grid();
  const auto layers = test::ReferenceNetwork(weights).layers(
      test::layer_of(voxels.sites, voxels.features), {grid.z, grid.y, grid.x});
  std::set<std::string> left = truth.layers();
  for (const auto& [name, layer] : layers) {
    ASSERT_EQ(left.erase(name), 1U) << name;
    EXPECT_LT(largest_difference(layer, truth.rows(name)), kTolerance) << name;
  }
  EXPECT_EQ(left, (std::set<std::string>{"voxels", "head0.vel.1", "head1.vel.1"}));
}

TEST(VoxelNextOfOpenPcdet, GivesNearlyWhatPyTorchGivesInEveryLayer) {
  const VoxelNextWeights weights = read_voxelnext_weights(file_named("weights.safetensors"));
  const VoxelNext network(weights);
  const Truth truth;
  std::set<std::string> left = truth.layers();
  left.erase("voxels");
  const auto compare = [&](const std::string& layer, const Rows& found) {
    ASSERT_TRUE(left.contains(layer)) << layer;
    left.erase(layer);
    EXPECT_LT(relative_difference(found, truth.rows(layer)), kToleranceOfBytes) << layer;
  };
  NetworkObserver observer;
  observer.layer = [&](std::string_view layer, const SiteSet& sites, const FeatureRows& rows) {
    compare(std::string(layer), rows_of(sites, rows));
  };
  const VoxelNext::Neck neck = network.backbone(voxels_of(truth, weights.config), observer);
  (void)network.heat_maps(neck, observer);
  std::vector<std::uint32_t> all(neck.cells.size());
  for (std::uint32_t cell = 0; cell < all.size(); ++cell) all[cell] = cell;
  for (std::size_t h = 0; h < weights.config.heads.size(); ++h) {
    const HeadBoxes boxes = network.boxes(neck, h, all);
    for (const auto& [branch, column] : boxes.column) {
      const auto channels = channels_of(branch, weights.config.heads[h].classes.size());
      Rows found;
      for (std::size_t i = 0; i < all.size(); ++i) {
        const Triple& cell = neck.cells[i];
        const float* row = boxes.values.row(i) + column;
        found[{cell.z, cell.y, cell.x}] = std::vector<float>(row, row + channels);
      }
      compare("head" + std::to_string(h) + "." + std::string(name_of(branch)) + ".1", found);
    }
  }
  // Velocities are not used, so not computed.
  EXPECT_EQ(left, (std::set<std::string>{"head0.vel.1", "head1.vel.1"}));
}

TEST(VoxelNextOfOpenPcdet, ReadsTheConfigThatWasConverted) {
  const VoxelNextConfig config = read_voxelnext_weights(file_named("weights.safetensors")).config;
  EXPECT_EQ(config.z, VoxelNextHeight::kLidar);
  EXPECT_EQ(config.stages[2].kernel, 5);
  ASSERT_EQ(config.heads.size(), 2U);
  EXPECT_EQ(config.heads[0].classes, (std::vector<std::optional<maps::ObjectClass>>{
                                         maps::ObjectClass::kTruck, std::nullopt}));
  // There by CLASS_NAMES (car, truck, barrier), here by heads (truck, barrier, car).
  EXPECT_EQ(config.iou_rectifier, (std::vector{0.2, 0.3, 0.1}));
  EXPECT_EQ(config.nms_iou, 0.3);
}

}  // namespace voxelnext_openpcdet_test
}  // namespace stillmap::mapping

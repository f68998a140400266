#include "detection/voxelnext/voxelnext_detector.hpp"

#include "detection/bev_overlap.hpp"
#include "detection/voxelnext/decoding.hpp"
#include "fusion/box_frames.hpp"
#include "support/synthetic_world.hpp"
#include "support/voxelnext_weights.hpp"
#include "voxelnext_reference.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <stdexcept>

namespace stillmap::test {
namespace voxelnext_detector_test {

using mapping::FeatureRows;
using mapping::SiteSet;
using mapping::VoxelFeature;
using mapping::VoxelNextBranch;
using mapping::VoxelNextConfig;
using mapping::VoxelNextDetector;
using mapping::VoxelNextHeight;
using mapping::VoxelNextSuppression;
using maps::ObjectClass;
using ::testing::IsEmpty;
using ::testing::SizeIs;

/// Flat ground at a height, known within a radius only.
class FlatGround : public mapping::GroundSurface {
 public:
  explicit FlatGround(double z, double radius_m = 1e9) : z_(z), radius_m_(radius_m) {}
  [[nodiscard]] std::optional<Sample> at(double x, double y) const override {
    if (std::hypot(x, y) > radius_m_) return std::nullopt;
    return Sample{z_, Eigen::Vector3d::UnitZ(), 1.0};
  }

 private:
  double z_, radius_m_;
};

mapping::GroundResult flat(double z, double radius_m = 1e9) {
  return {{}, std::make_shared<FlatGround>(z, radius_m)};
}

VoxelNextConfig small_config() {
  VoxelNextConfig config;
  config.name = "small";
  config.range_m = {-10.0, -12.8, 0.0, 10.8, 12.8, 2.5};
  config.voxel_m = {0.2, 0.2, 0.25};
  config.features = {VoxelFeature::kDx,     VoxelFeature::kDy, VoxelFeature::kDz,
                     VoxelFeature::kHeight, VoxelFeature::kUx, VoxelFeature::kUy};
  config.stages = {{{4, 1, 3}, {8, 2, 3}, {12, 1, 5}, {20, 1, 3}, {20, 0, 3}, {20, 1, 3}}};
  config.neck_channels = 18;
  config.head_kernel = 3;
  config.heads = {{{ObjectClass::kCar, ObjectClass::kVan}}, {{ObjectClass::kPedestrian}}};
  config.branches = {VoxelNextBranch::kHm,  VoxelNextBranch::kCenter, VoxelNextBranch::kCenterZ,
                     VoxelNextBranch::kDim, VoxelNextBranch::kRot,    VoxelNextBranch::kIou,
                     VoxelNextBranch::kVel};
  config.iou_rectifier = {0.5, 0.0, 0.3};
  config.calibration = {{1.0, 0.0}, {0.8, -0.1}, {1.2, 0.3}};
  config.score_threshold = {0.3, 0.3, 0.3};
  return config;
}

/// Points all over the range and some beyond.
maps::Scan random_scan(std::uint64_t seed, std::size_t points) {
  Random random(seed);
  maps::Scan scan;
  for (std::size_t k = 0; k < points; ++k) {
    scan.cloud.positions.emplace_back(static_cast<float>(random.uniform(-12.0, 12.0)),
                                      static_cast<float>(random.uniform(-14.0, 14.0)),
                                      static_cast<float>(random.uniform(-0.3, 2.8)));
  }
  return scan;
}

bool same_bits(const std::vector<maps::Box>& a, const std::vector<maps::Box>& b) {
  return std::ranges::equal(a, b, [](const maps::Box& p, const maps::Box& q) {
    return p.centre == q.centre && p.size_m == q.size_m && p.yaw_rad == q.yaw_rad &&
           p.score == q.score && p.object_class == q.object_class;
  });
}

TEST(Voxels, HoldTheMeansOfTheirPoints) {
  VoxelNextConfig config = small_config();
  using enum VoxelFeature;
  config.features = {kX, kY, kZ, kIntensity, kZero, kDx, kDy, kDz, kHeight, kUx, kUy};
  maps::PointCloud cloud;
  // Both in the voxel x 3.0 to 3.2, y 4.0 to 4.2, height 0.5 to 0.75.
  cloud.positions = {{3.05F, 4.1F, -1.4F}, {3.15F, 4.0F, -1.3F}};
  cloud.intensities = {10.0F, 30.0F};
  const FlatGround ground(-2.0);
  const mapping::Voxels voxels =
      mapping::voxelize(config, cloud, mapping::NetworkHeight(config, &ground));
  ASSERT_EQ(voxels.sites.size(), 1U);
  EXPECT_EQ(voxels.sites[0], (mapping::Triple{2, 84, 65}));
  EXPECT_EQ(voxels.sites.grid(), (mapping::Triple{11, 128, 104}));
  const double r = std::hypot(3.1, 4.05);
  const std::vector<double> expected{3.1,   4.05, 0.65, 20.0,    0.0,     0.0,
                                     -0.25, 0.1,  0.65, 3.1 / r, 4.05 / r};
  for (std::size_t f = 0; f < expected.size(); ++f)
    EXPECT_NEAR(voxels.features.row(0)[f], expected[f], 2e-6) << "feature " << f;
}

TEST(Voxels, TakeTheLowerEdgeOfTheRangeAndNotTheUpper) {
  const VoxelNextConfig config = small_config();
  const FlatGround ground(0.0);
  const auto count = [&](float x, float y, float z) {
    maps::PointCloud cloud;
    cloud.positions = {{x, y, z}};
    return mapping::voxelize(config, cloud, mapping::NetworkHeight(config, &ground)).sites.size();
  };
  EXPECT_EQ(count(-10.0F, 0.0F, 0.0F), 1U);
  EXPECT_EQ(count(0.0F, -12.8F, 0.0F), 0U) << "-12.8 as a float is below -12.8";
  EXPECT_EQ(count(0.0F, std::nextafter(-12.8F, 0.0F), 0.0F), 1U);
  EXPECT_EQ(count(10.8F, 0.0F, 0.0F), 0U) << "10.8 as a float is above 10.8";
  EXPECT_EQ(count(std::nextafter(10.8F, 0.0F), 0.0F, 0.0F), 1U);
  EXPECT_EQ(count(0.0F, 0.0F, 2.5F), 0U);
  EXPECT_EQ(count(0.0F, 0.0F, std::nextafter(2.5F, 0.0F)), 1U);
  EXPECT_EQ(count(0.0F, 0.0F, -1e-6F), 0U);
  EXPECT_EQ(count(std::numeric_limits<float>::quiet_NaN(), 0.0F, 0.0F), 0U);
}

TEST(Voxels, LeavePointsOutWhereNoGroundIsKnown) {
  const VoxelNextConfig config = small_config();
  maps::PointCloud cloud;
  cloud.positions = {{3.0F, 0.0F, 1.0F}, {9.0F, 0.0F, 1.0F}};
  const FlatGround ground(0.0, 5.0);
  EXPECT_EQ(mapping::voxelize(config, cloud, mapping::NetworkHeight(config, &ground)).sites.size(),
            1U);
  EXPECT_EQ(mapping::voxelize(config, cloud, mapping::NetworkHeight(config, nullptr)).sites.size(),
            0U);
}

TEST(Voxels, AsMeasuredTheGroundUnderTheSensorLiesAtTheSensorsHeight) {
  VoxelNextConfig config = small_config();
  config.z = VoxelNextHeight::kLidar;
  config.sensor_height_m = 1.8;
  // The sensor is really 2.5 m up: what lies on the ground there is at -1.8 for the network.
  const FlatGround ground(-2.5, 1.0);
  const mapping::NetworkHeight height(config, &ground);
  EXPECT_NEAR(-2.5 - height.zero_at(9.0, 9.0).value(), -1.8, 1e-12);
  EXPECT_EQ(mapping::NetworkHeight(config, nullptr).zero_at(3.0, 0.0), 0.0);
}

/// Each stage's pruning.
class VoxelNextLayers : public testing::TestWithParam<mapping::VoxelNextPruning> {};

INSTANTIATE_TEST_SUITE_P(Pruning, VoxelNextLayers,
                         testing::Values(mapping::VoxelNextPruning{},
                                         mapping::VoxelNextPruning{0.5, 0.5, 0.5, 0.0, 0.0},
                                         mapping::VoxelNextPruning{0.0, 0.3, 0.0, 0.5, 0.9}));

TEST_P(VoxelNextLayers, AreWhatTheirDefinitionsSay) {
  mapping::VoxelNextWeights weights = random_weights(small_config(), 3);
  weights.config.pruning = GetParam();
  const mapping::VoxelNext network(weights);
  const FlatGround ground(0.0);
  mapping::Voxels voxels = mapping::voxelize(weights.config, random_scan(4, 600).cloud,
                                             mapping::NetworkHeight(weights.config, &ground));
  const mapping::Triple grid = voxels.sites.grid();
  const Layer input = layer_of(voxels.sites, voxels.features);
  std::map<std::string, Layer> found;
  mapping::NetworkObserver observer;
  observer.layer = [&](std::string_view name, const SiteSet& sites, const FeatureRows& rows) {
    found[std::string(name)] = layer_of(sites, rows);
  };
  const mapping::VoxelNext::Neck neck = network.backbone(std::move(voxels), observer);
  static_cast<void>(network.heat_maps(neck, observer));
  EXPECT_EQ(found.size(), 6U + 12U + 3U + 2U);
  const std::map<std::string, Layer> expected =
      ReferenceNetwork(weights, &found).layers(input, {grid.z, grid.y, grid.x});
  for (const auto& [name, layer] : found) {
    SCOPED_TRACE(name);
    const Layer& truth = expected.at(name);
    ASSERT_EQ(cells_of(layer), cells_of(truth));
    double largest = 0.0, error = 0.0;
    for (const auto& [cell, row] : truth) {
      for (std::size_t c = 0; c < row.size(); ++c) {
        largest = std::max(largest, std::abs(row[c]));
        error = std::max(error, std::abs(row[c] - layer.at(cell)[c]));
      }
    }
    EXPECT_GT(largest, 1e-3);
    EXPECT_LT(error, 1e-5 * (1.0 + largest));
  }
  for (std::size_t head = 0; head < 2; ++head) {
    std::vector<std::uint32_t> cells;
    for (std::uint32_t cell = 1; cell < neck.cells.size(); cell += 2) cells.push_back(cell);
    const mapping::HeadBoxes boxes = network.boxes(neck, head, cells);
    EXPECT_EQ(boxes.column.size(), 5U) << "velocity is not asked for";
    for (const auto& [branch, column] : boxes.column) {
      const Layer& truth = expected.at("head" + std::to_string(head) + "." +
                                       std::string(mapping::name_of(branch)) + ".1");
      for (std::size_t row = 0; row < cells.size(); ++row) {
        const std::vector<double>& values = truth.at(cell_of(neck.cells[cells[row]]));
        for (std::size_t c = 0; c < values.size(); ++c)
          ASSERT_NEAR(boxes.values.row(row)[column + c], values[c], 1e-4);
      }
    }
  }
}

TEST(VoxelNext, RefusesLayersOfTheWrongShape) {
  mapping::VoxelNextWeights weights = random_weights(small_config(), 3);
  Random random(1);
  weights.add("stage3.down", random_convolution(random, 27, 8, 12));
  EXPECT_THROW(mapping::VoxelNext{weights}, std::invalid_argument);
  weights = random_weights(small_config(), 3);
  weights.config.stages[4].blocks = 1;
  EXPECT_THROW(mapping::VoxelNext{weights}, std::invalid_argument);
}

/// One cell that answers with given numbers.
struct OneCell {
  SiteSet cells{{1, 16, 13}};
  mapping::HeadBoxes boxes;

  OneCell() {
    cells.mark({0, 9, 5});
    cells.number_sites();
    boxes.cells = {0};
    boxes.values = FeatureRows(1, 5 * 16);
    std::size_t column = 0;
    for (const auto& [branch, values] : std::map<VoxelNextBranch, std::vector<float>>{
             {VoxelNextBranch::kCenter, {0.25F, -0.5F}},
             {VoxelNextBranch::kCenterZ, {0.75F}},
             {VoxelNextBranch::kDim, {std::log(4.0F), std::log(1.75F), std::log(1.5F)}},
             {VoxelNextBranch::kRot, {0.6F, -0.8F}},
             {VoxelNextBranch::kIou, {0.28F}}}) {
      boxes.column[branch] = column;
      std::copy(values.begin(), values.end(), boxes.values.data() + column);
      column += 16;
    }
  }
};

TEST(Decoding, TurnsAnswersIntoABox) {
  const VoxelNextConfig config = small_config();
  const OneCell one;
  const FlatGround ground(-1.5);
  const mapping::NetworkHeight height(config, &ground);
  const auto boxes = mapping::decode_boxes(config, 0, {{0, 0, 0.81}}, one.cells, one.boxes, height);
  ASSERT_THAT(boxes, SizeIs(1));
  const maps::Box& box = boxes[0];
  EXPECT_NEAR(box.centre.x(), 5.25 * 1.6 - 10.0, 1e-6);
  EXPECT_NEAR(box.centre.y(), 8.5 * 1.6 - 12.8, 1e-6);
  EXPECT_NEAR(box.centre.z(), -0.75, 1e-6);
  EXPECT_NEAR((box.size_m - Eigen::Vector3d(4.0, 1.75, 1.5)).norm(), 0.0, 1e-6);
  EXPECT_NEAR(box.yaw_rad, std::atan2(-0.8, 0.6), 1e-6);
  EXPECT_EQ(box.object_class, ObjectClass::kCar);
  // sqrt(0.81) * sqrt((0.28 + 1) / 2)
  EXPECT_NEAR(box.score, 0.9 * 0.8, 1e-6);
}

TEST(Decoding, AnAxisIsHalfTheAngle) {
  VoxelNextConfig config = small_config();
  config.yaw = mapping::VoxelNextYaw::kAxis;
  const OneCell one;
  const FlatGround ground(0.0);
  const auto boxes = mapping::decode_boxes(config, 0, {{0, 0, 0.8}}, one.cells, one.boxes,
                                           mapping::NetworkHeight(config, &ground));
  ASSERT_THAT(boxes, SizeIs(1));
  EXPECT_NEAR(boxes[0].yaw_rad, std::atan2(-0.8, 0.6) / 2.0, 1e-6);
}

TEST(Decoding, TheThresholdIsOfTheScoreWithTheIou) {
  VoxelNextConfig config = small_config();
  const OneCell one;
  const FlatGround ground(0.0);
  const mapping::NetworkHeight height(config, &ground);
  // sqrt(0.25 * 0.64) = 0.4
  for (const auto& [threshold, count] : {std::pair{0.39, 1U}, std::pair{0.41, 0U}}) {
    config.score_threshold = {threshold, 0.0, 0.0};
    EXPECT_THAT(mapping::decode_boxes(config, 0, {{0, 0, 0.25}}, one.cells, one.boxes, height),
                SizeIs(count));
  }
}

TEST(Decoding, LeavesScoresAloneWithoutARectifier) {
  const VoxelNextConfig config = small_config();
  const OneCell one;
  const FlatGround ground(0.0);
  const auto boxes = mapping::decode_boxes(config, 0, {{0, 1, 0.4}}, one.cells, one.boxes,
                                           mapping::NetworkHeight(config, &ground));
  ASSERT_THAT(boxes, SizeIs(1));
  EXPECT_EQ(boxes[0].score, 0.4);
  EXPECT_EQ(boxes[0].object_class, ObjectClass::kVan);
}

TEST(Decoding, LimitsSizesAndDropsWhatIsNotFinite) {
  const VoxelNextConfig config = small_config();
  OneCell one;
  const FlatGround ground(0.0);
  const mapping::NetworkHeight height(config, &ground);
  const auto decode = [&] {
    return mapping::decode_boxes(config, 0, {{0, 0, 0.8}}, one.cells, one.boxes, height);
  };
  one.boxes.values.data()[one.boxes.column[VoxelNextBranch::kDim]] = 80.0F;
  ASSERT_THAT(decode(), SizeIs(1));
  EXPECT_NEAR(decode()[0].size_m.x(), std::exp(5.0), 1e-9);
  for (const VoxelNextBranch branch :
       {VoxelNextBranch::kCenter, VoxelNextBranch::kCenterZ, VoxelNextBranch::kDim,
        VoxelNextBranch::kRot, VoxelNextBranch::kIou}) {
    one = OneCell();
    one.boxes.values.data()[one.boxes.column[branch]] = std::numeric_limits<float>::quiet_NaN();
    EXPECT_THAT(decode(), IsEmpty()) << mapping::name_of(branch);
  }
}

TEST(Decoding, DropsBoxesOverUnknownGround) {
  const VoxelNextConfig config = small_config();
  const OneCell one;
  const FlatGround ground(0.0, 1.0);
  EXPECT_THAT(mapping::decode_boxes(config, 0, {{0, 0, 0.8}}, one.cells, one.boxes,
                                    mapping::NetworkHeight(config, &ground)),
              IsEmpty());
}

struct HeatMap {
  SiteSet cells{{1, 8, 8}};
  FeatureRows logits;
  HeatMap(const std::vector<std::pair<int, float>>& row_of_x_and_logit, std::size_t classes) {
    for (const auto& [x, logit] : row_of_x_and_logit) cells.mark({0, 4, x});
    cells.number_sites();
    logits = FeatureRows(cells.size(), classes);
    for (const auto& [x, logit] : row_of_x_and_logit) {
      for (std::size_t c = 0; c < classes; ++c) logits.row(cells.find({0, 4, x}))[c] = logit;
    }
  }
};

TEST(Candidates, AreCellsAndClassesAtOrAboveTheThreshold) {
  VoxelNextConfig config = small_config();
  config.iou_rectifier.assign(config.iou_rectifier.size(), 0.0);
  config.score_threshold = {0.5, 0.5, 0.5};
  config.calibration = {{1.0, 0.0}, {2.0, 1.0}, {1.0, 0.0}};
  const HeatMap map({{1, 0.0F}, {2, -0.25F}, {3, -1.0F}, {5, std::nanf("")}}, 2);
  const auto found = mapping::find_candidates(config, 0, map.cells, map.logits);
  ASSERT_THAT(found, SizeIs(3));
  EXPECT_EQ(found[0].cell, 0U);
  EXPECT_EQ(found[0].head_class, 0U);
  EXPECT_EQ(found[0].probability, 0.5);
  EXPECT_EQ(found[1].head_class, 1U);
  EXPECT_NEAR(found[1].probability, 1.0 / (1.0 + std::exp(-1.0)), 1e-12);
  EXPECT_EQ(found[2].cell, 1U);
  EXPECT_EQ(found[2].head_class, 1U);
}

TEST(Candidates, EachClassHasItsOwnThreshold) {
  VoxelNextConfig config = small_config();
  config.iou_rectifier.assign(config.iou_rectifier.size(), 0.0);
  config.score_threshold = {0.6, 0.4, 0.4};
  config.calibration.assign(config.calibration.size(), {1.0, 0.0});
  const HeatMap map({{1, 0.0F}}, 2);
  const auto found = mapping::find_candidates(config, 0, map.cells, map.logits);
  ASSERT_THAT(found, SizeIs(1));
  EXPECT_EQ(found[0].head_class, 1U);
}

TEST(Candidates, OfAClassThatIsNoObjectForUsDoNotExist) {
  VoxelNextConfig config = small_config();
  config.heads[0].classes[0] = std::nullopt;
  const HeatMap map({{1, 3.0F}}, 2);
  const auto found = mapping::find_candidates(config, 0, map.cells, map.logits);
  ASSERT_THAT(found, SizeIs(1));
  EXPECT_EQ(found[0].head_class, 1U);
}

TEST(Candidates, ArePeaksAmongActiveNeighboursWithMaxPooling) {
  VoxelNextConfig config = small_config();
  config.nms = VoxelNextSuppression::kMaxPool;
  // The cell at x = 4 is not active, so the one beyond it is no neighbour.
  const HeatMap map({{1, 1.0F}, {2, 2.0F}, {3, 1.5F}, {5, 1.0F}}, 2);
  const auto found = mapping::find_candidates(config, 0, map.cells, map.logits);
  ASSERT_THAT(found, SizeIs(4));
  EXPECT_EQ(map.cells[found[0].cell].x, 2);
  EXPECT_EQ(map.cells[found[2].cell].x, 5);
}

double bev_iou(const maps::Box& a, const maps::Box& b) {
  return mapping::overlap_of(a, b).of_joint;
}

maps::Box box_at(double x, double y, double yaw_rad, double score) {
  maps::Box box;
  box.centre = {x, y, 0.0};
  box.size_m = {4.0, 2.0, 1.5};
  box.yaw_rad = yaw_rad;
  box.score = score;
  return box;
}

TEST(BevIou, IsTheShareOfTheAreaThatBothCover) {
  using std::numbers::pi;
  const maps::Box a = box_at(10.0, 5.0, 0.7, 1.0);
  EXPECT_NEAR(bev_iou(a, a), 1.0, 1e-12);
  EXPECT_NEAR(bev_iou(a, box_at(10.0, 5.0, 0.7 + pi, 1.0)), 1.0, 1e-12);
  // Crossed: 2 x 2 of 2 * 8 - 4.
  EXPECT_NEAR(bev_iou(a, box_at(10.0, 5.0, 0.7 + pi / 2, 1.0)), 4.0 / 12.0, 1e-12);
  // Moved by half a length.
  EXPECT_NEAR(bev_iou(box_at(0, 0, 0, 1), box_at(2, 0, 0, 1)), 4.0 / 12.0, 1e-12);
  // A diamond on a square of the same sides: an octagon.
  maps::Box square = box_at(1.0, 2.0, 0.3, 1.0);
  square.size_m = {2.0, 2.0, 1.0};
  maps::Box diamond = square;
  diamond.yaw_rad += pi / 4;
  const double octagon = 8.0 * (std::numbers::sqrt2 - 1.0);
  EXPECT_NEAR(bev_iou(square, diamond), octagon / (8.0 - octagon), 1e-12);
  EXPECT_EQ(bev_iou(box_at(0, 0, 0, 1), box_at(4, 0, 0, 1)), 0.0) << "they touch";
  EXPECT_EQ(bev_iou(box_at(0, 0, 0.2, 1), box_at(40, 0, 0, 1)), 0.0);
}

TEST(BevIou, OfASmallBoxInsideALargeOneIsTheRatioOfAreas) {
  maps::Box small = box_at(0.3, -0.1, 1.1, 1.0);
  small.size_m = {0.5, 0.4, 1.0};
  EXPECT_NEAR(bev_iou(small, box_at(0, 0, 0.2, 1)), 0.2 / 8.0, 1e-12);
  EXPECT_NEAR(bev_iou(box_at(0, 0, 0.2, 1), small), 0.2 / 8.0, 1e-12);
}

TEST(SuppressOverlaps, KeepsTheHigherScoreAndWhatLiesApart) {
  const std::vector<maps::Box> kept = mapping::suppress_overlaps(
      {box_at(0, 0, 0, 0.5), box_at(1, 0, 0, 0.9), box_at(0, 3, 0, 0.2), box_at(2.5, 0, 0, 0.6)},
      0.2);
  // 0.5 overlaps 0.9 by 6 / 10; 0.6 overlaps 0.9 by 5 / 11 and so goes too.
  ASSERT_THAT(kept, SizeIs(2));
  EXPECT_EQ(kept[0].score, 0.9);
  EXPECT_EQ(kept[1].score, 0.2);
}

/// As its definition says: each box with every one kept so far.
std::vector<maps::Box> suppressed_one_by_one(std::vector<maps::Box> boxes, double most_iou) {
  std::ranges::stable_sort(boxes, std::ranges::greater{}, &maps::Box::score);
  std::vector<maps::Box> kept;
  for (const maps::Box& box : boxes) {
    if (std::ranges::none_of(
            kept, [&](const maps::Box& other) { return bev_iou(box, other) > most_iou; }))
      kept.push_back(box);
  }
  return kept;
}

/// Boxes of equal scores, of sizes from a post to a house, at corners of cells, and far away.
std::vector<maps::Box> many_boxes(Random& random, std::size_t count, double range_m) {
  std::vector<maps::Box> out;
  for (std::size_t k = 0; k < count; ++k) {
    maps::Box box = box_at(random.uniform(-range_m, range_m), random.uniform(-range_m, range_m),
                           random.uniform(-4.0, 4.0), std::round(random.uniform(0.0, 20.0)));
    if (k % 5 == 0) box.size_m *= std::exp(random.uniform(-3.0, 3.5));
    if (k % 7 == 0) box.centre = box.centre.array().round();
    if (k % 50 == 0) box.centre.x() += 1e14;
    out.push_back(box);
  }
  return out;
}

TEST(SuppressOverlaps, IsTheSameAsComparingAllPairs) {
  Random random(31);
  for (const double range_m : {2.0, 12.0, 40.0}) {
    for (const double most_iou : {0.0, 0.2, 0.7, 1.0}) {
      const std::vector<maps::Box> boxes = many_boxes(random, 120, range_m);
      const std::vector<maps::Box> kept = mapping::suppress_overlaps(boxes, most_iou);
      EXPECT_TRUE(same_bits(kept, suppressed_one_by_one(boxes, most_iou)))
          << kept.size() << " kept within " << range_m << " m at " << most_iou;
    }
  }
  EXPECT_THAT(mapping::suppress_overlaps({}, 0.2), IsEmpty());
}

TEST(SuppressOverlaps, KeepsBoxesWithoutAnyArea) {
  std::vector<maps::Box> boxes(3, box_at(1.0, 2.0, 0.3, 0.5));
  for (maps::Box& box : boxes) box.size_m.setZero();
  EXPECT_THAT(mapping::suppress_overlaps(boxes, 0.0), SizeIs(3));
}

TEST(VoxelNextDetector, FindsTheSameOnAnyNumberOfThreads) {
  mapping::VoxelNextWeights weights = random_weights(small_config(), 5);
  weights.config.pruning = {0.5, 0.5, 0.5, 0.0, 0.0};
  const VoxelNextDetector detector(weights);
  const maps::Scan scan = random_scan(6, 3000);
  const auto on_threads = [&](int threads) {
    tbb::task_arena arena(threads);
    return arena.execute([&] { return detector.detect(scan, flat(0.0)); });
  };
  const std::vector<maps::Box> one = on_threads(1);
  ASSERT_THAT(one, testing::Not(IsEmpty()));
  EXPECT_TRUE(same_bits(one, on_threads(2)));
  EXPECT_TRUE(same_bits(one, on_threads(5)));
}

TEST(VoxelNextDetector, ThinksOfNothingInAnEmptyScan) {
  const VoxelNextDetector detector(random_weights(small_config(), 5));
  EXPECT_THAT(detector.detect({}, flat(0.0)), IsEmpty());
  EXPECT_THAT(detector.detect({}, {}), IsEmpty());
  // Nothing in range.
  maps::Scan far;
  far.cloud.positions = {{500.0F, 0.0F, 1.0F}};
  EXPECT_THAT(detector.detect(far, flat(0.0)), IsEmpty());
}

TEST(VoxelNextDetector, TakesASinglePointAnywhere) {
  VoxelNextConfig config = small_config();
  config.score_threshold = {0.0, 0.0, 0.0};
  config.nms_iou = 1.0;
  const VoxelNextDetector detector(random_weights(config, 5));
  for (const float x : {-10.0F, 0.0F, 10.79F}) {
    maps::Scan scan;
    scan.cloud.positions = {{x, 12.79F, 2.49F}};
    const auto boxes = detector.detect(scan, flat(0.0));
    EXPECT_THAT(boxes, testing::Not(IsEmpty()));
    for (const maps::Box& box : boxes) {
      EXPECT_TRUE(box.centre.allFinite());
      EXPECT_GT(box.size_m.minCoeff(), 0.0);
      EXPECT_GE(box.score, 0.0);
      EXPECT_LE(box.score, 1.0);
    }
  }
}

/// The largest cells, of stage 6, are 32 voxels wide: moved by whole ones, everything moves along.
TEST(VoxelNextDetector, MovesWithTheSceneByWholeStrides) {
  VoxelNextConfig config = small_config();
  config.range_m = {-48.0, -48.0, 0.0, 48.0, 48.0, 2.5};
  // A voxel and moves that are exact in binary, and no feature that tells where it is.
  config.voxel_m = {0.25, 0.25, 0.25};
  config.features = {VoxelFeature::kDx, VoxelFeature::kDy, VoxelFeature::kDz,
                     VoxelFeature::kHeight};
  const VoxelNextDetector detector(random_weights(config, 5));
  maps::Scan scan, moved;
  Random random(8);
  for (int k = 0; k < 400; ++k) {
    // Multiples of 2^-10, which no move rounds.
    const auto coordinate = [&](double low, double high) {
      return static_cast<float>(std::floor(random.uniform(low, high) * 1024.0) / 1024.0);
    };
    const Eigen::Vector3f p(coordinate(-4.0, 4.0), coordinate(-4.0, 4.0), coordinate(0.0, 2.0));
    scan.cloud.positions.push_back(p);
    moved.cloud.positions.push_back(p + Eigen::Vector3f(16.0F, -8.0F, 0.0F));
  }
  std::vector<maps::Box> here = detector.detect(scan, flat(0.0));
  const std::vector<maps::Box> there = detector.detect(moved, flat(0.0));
  ASSERT_THAT(here, testing::Not(IsEmpty()));
  ASSERT_EQ(here.size(), there.size());
  for (std::size_t k = 0; k < here.size(); ++k) {
    EXPECT_NEAR((there[k].centre - here[k].centre - Eigen::Vector3d(16.0, -8.0, 0.0)).norm(), 0.0,
                1e-9);
    EXPECT_EQ(there[k].size_m, here[k].size_m);
    EXPECT_EQ(there[k].yaw_rad, here[k].yaw_rad);
    EXPECT_EQ(there[k].score, here[k].score);
  }
}

TEST(VoxelNextDetector, RefusesAConfigWithoutANumberForEachClass) {
  mapping::VoxelNextWeights weights = random_weights(small_config(), 5);
  weights.config.calibration.pop_back();
  EXPECT_THROW(VoxelNextDetector{weights}, std::invalid_argument);
  weights = random_weights(small_config(), 5);
  weights.config.branches.erase(weights.config.branches.begin() + 1);
  EXPECT_THROW(VoxelNextDetector{weights}, std::invalid_argument);
  weights = random_weights(small_config(), 5);
  weights.config.pruning[2] = 1.0;
  EXPECT_THROW(VoxelNextDetector{weights}, std::invalid_argument);
}

TEST(MakeDetector, SaysWhatIsWrongWithWeights) {
  EXPECT_THROW(static_cast<void>(mapping::make_detector("voxelnext:/no/such/file", 1)),
               std::runtime_error);
  EXPECT_THROW(static_cast<void>(mapping::make_detector("voxelnext:", 1)), std::invalid_argument);
}

}  // namespace voxelnext_detector_test
}  // namespace stillmap::test

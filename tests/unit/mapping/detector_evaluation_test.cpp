#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/detector_evaluation.hpp>
#include <stillmap/maps/error.hpp>

#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>

#include "evaluation/detector/box_figures.hpp"
#include "evaluation/detector/point_tally.hpp"
#include "small_drive.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace detector_evaluation_test {

using maps::InputError;
using test::ThrowsSaying;
using ::testing::DoubleNear;
using ::testing::FieldsAre;
using ::testing::HasSubstr;
using ::testing::Not;

class EvaluateDetector : public ::testing::Test {
 protected:
  EvaluateDetector() : drive_(small_.write(folder_)) {
    for (std::size_t i = 0; i < test::SmallDrive::kScans; ++i) truth_.by_scan[i] = {car(i)};
    found_ = truth_;
  }

  [[nodiscard]] maps::Box car(std::size_t scan) const {
    maps::Box box = small_.car_in(scan);
    box.track = 7;
    return box;
  }
  DetectorEvaluation evaluate(bool draw = false) {
    maps::write_boxes(drive_ / "boxes.json", truth_);
    maps::write_boxes(folder_.path() / "found.json", found_);
    options_.detector = "boxes:" + (folder_.path() / "found.json").string();
    return evaluate_detector(maps::Drive::open(drive_), options_, draw, {}, cancel_);
  }
  /// Faces of the true box are the surface itself, so rounding decides on their points.
  void find_grown_boxes() {
    for (std::size_t i = 0; i < test::SmallDrive::kScans; ++i) {
      maps::Box grown = car(i);
      grown.size_m += Eigen::Vector3d::Constant(0.1);
      found_.by_scan[i] = {grown};
    }
  }
  /// The points of the car's faces as labels.
  void label_the_car(std::uint32_t car_label, std::uint32_t other_label) {
    for (std::size_t i = 0; i < test::SmallDrive::kScans; ++i) {
      std::string bytes;
      for (const Eigen::Vector3f& p : small_.scan(i).positions) {
        const bool on_car = car(i).contains(p.cast<double>(), 0.01) && p.z() > -1.7F;
        const std::uint32_t label = on_car ? car_label : other_label;
        bytes.append(reinterpret_cast<const char*>(&label), sizeof(label));
      }
      folder_.write(fmt::format("drive/labels/{:06}.label", i), bytes);
    }
  }

  test::TemporaryFolder folder_;
  test::SmallDrive small_;
  std::filesystem::path drive_;
  maps::BoxSequence truth_, found_;
  DetectorEvaluationOptions options_;
  CancelFlag cancel_{false};
};

TEST_F(EvaluateDetector, FindsTrueBoxesPerfect) {
  const DetectorEvaluation result = evaluate();
  const auto json = nlohmann::json::parse(to_json(result));
  EXPECT_EQ(json["scans"], 4);
  for (const char* const iou : {"0.3", "0.5", "0.7"}) {
    EXPECT_DOUBLE_EQ(json["AP"]["vehicle"][iou], 1.0);
    EXPECT_DOUBLE_EQ(json["AP"]["car"][iou], 1.0);
  }
  EXPECT_TRUE(json["AP"]["pedestrian"]["0.3"].is_null());
  EXPECT_FALSE(json["AP"].contains("truck"));
  const auto& curve = json["curves"]["vehicle"];
  EXPECT_EQ(curve["iou"], 0.5);
  EXPECT_DOUBLE_EQ(curve["score_precision_recall"].back()[0], 0.01);
  EXPECT_DOUBLE_EQ(curve["score_precision_recall"].back()[1], 1.0);
  EXPECT_DOUBLE_EQ(curve["score_precision_recall"].back()[2], 1.0);
  EXPECT_DOUBLE_EQ(json["recall_centre_1_5m"]["vehicle"], 1.0);
  EXPECT_DOUBLE_EQ(json["false_boxes_per_scan"], 0.0);
  EXPECT_TRUE(json["points"]["movable_recall"].is_null());
  EXPECT_EQ(json["well_seen"]["vehicle"]["tracks"][0]["track"], 7);
  EXPECT_EQ(json["well_seen"]["vehicle"]["of"], 4);
}

TEST_F(EvaluateDetector, CountsFalseBoxesAndMissesByScanAndTrack) {
  found_.by_scan[0].push_back(car(0));  // twice
  found_.by_scan[1].front().centre.y() -= 6.0;
  found_.by_scan.erase(2);
  maps::Box far = car(3);
  far.centre.x() = 60.0;
  found_.by_scan[3].push_back(far);
  const DetectorEvaluation result = evaluate();
  const BoxDetection& boxes = *result.boxes;
  EXPECT_EQ(boxes.false_vehicles, 2U);
  EXPECT_EQ(boxes.ignored_vehicles, 1U);
  EXPECT_DOUBLE_EQ(boxes.false_boxes_per_scan, 0.5);
  const ClassDetection& vehicle = boxes.classes.front();
  EXPECT_EQ(vehicle.all.found.count, 2U);
  EXPECT_EQ(vehicle.all.found.of, 4U);
  ASSERT_EQ(vehicle.all.tracks.size(), 1U);
  EXPECT_EQ(boxes.distances.at(0).found.of, 4U);
  EXPECT_DOUBLE_EQ(boxes.distances.at(0).false_boxes_per_scan, 0.5);
  EXPECT_EQ(boxes.distances.at(1).found.of, 0U);
}

TEST_F(EvaluateDetector, FarAndHardlySeenTruthDoesNotCount) {
  maps::Box hidden = car(0);
  hidden.centre = {10.0, 20.0, -1.0};  // behind the wall
  truth_.by_scan[0].push_back(hidden);
  maps::Box far = car(0);
  far.centre.x() = 70.0;
  truth_.by_scan[0].push_back(far);
  const DetectorEvaluation result = evaluate();
  EXPECT_EQ(result.boxes->ignored_truths, 2U);
  EXPECT_EQ(result.boxes->classes.front().all.found.of, 4U);
  options_.max_range_m = 5.0;
  EXPECT_EQ(evaluate().boxes->classes.front().all.found.of, 0U);
}

TEST(BoxFigures, VehiclesOfFewPointsCountForLessAndLess) {
  maps::Box car;
  car.object_class = maps::ObjectClass::kCar;
  car.size_m = {4.0, 2.0, 1.5};
  car.score = 0.5;
  ScanBoxes scan;
  for (const std::size_t points : {5U, 19U, 20U, 300U}) {
    car.centre.x() += 8.0;
    scan.truths.push_back({car, points});
    // Of the car of 19 points a box is found that is too far off.
    if (points == 19U) car.centre.y() += 0.8;
    scan.found.push_back(car);
    car.centre.y() = 0.0;
    scan.in_sight.push_back(1);
  }
  const std::vector<VisibilityDetection> by = box_figures({scan}, 50.0).visibilities;
  const auto row = [&](std::size_t i) {
    return std::tuple(by[i].min_points, by[i].found.of, by[i].average_precision);
  };
  ASSERT_EQ(by.size(), 5U);
  EXPECT_THAT(row(0), FieldsAre(5U, 4U, DoubleNear(0.75 * 30 / 40, 1e-9)));
  EXPECT_THAT(row(1), FieldsAre(10U, 3U, DoubleNear(2.0 / 3.0 * 26 / 40, 1e-9)));
  // From here on the box that is off lies on a car that does not count, and says nothing.
  EXPECT_THAT(row(2), FieldsAre(20U, 2U, 1.0));
  EXPECT_THAT(row(3), FieldsAre(50U, 1U, 1.0));
  EXPECT_THAT(row(4), FieldsAre(100U, 1U, 1.0));
}

TEST_F(EvaluateDetector, CountsPointsInsideOfBoxesByClass) {
  label_the_car(252, 40);
  const PointDetection all = *evaluate().points;
  EXPECT_EQ(all.scans, 4U);
  EXPECT_GT(all.movable.of, 100U);
  found_ = {};
  const PointDetection none = *evaluate().points;
  EXPECT_EQ(none.movable.count, 0U);
  EXPECT_EQ(none.stays.count, 0U);
  EXPECT_EQ(none.movable.of, all.movable.of);
  find_grown_boxes();
  const PointDetection grown = *evaluate().points;
  EXPECT_EQ(grown.movable.count, grown.movable.of);
  ASSERT_EQ(grown.classes.size(), 2U);
  EXPECT_EQ(grown.classes[0].name, "road");
  EXPECT_EQ(grown.classes[1].name, "car");
  EXPECT_TRUE(grown.classes[1].movable);
}

TEST_F(EvaluateDetector, SaysWhatFalseBoxesHold) {
  label_the_car(10, 51);
  maps::Box wall = car(0);
  wall.centre = {5.0, 8.2, -0.3};
  found_.by_scan[0].push_back(wall);
  const DetectorEvaluation result = evaluate();
  ASSERT_EQ(result.boxes->false_boxes_hold.size(), 1U);
  EXPECT_EQ(result.boxes->false_boxes_hold[0], (std::pair<std::string, std::size_t>{"fence", 1}));
}

TEST_F(EvaluateDetector, JudgesByPointsAloneWhereNoBoxIsLabelled) {
  label_the_car(10, 40);
  find_grown_boxes();
  (void)evaluate();
  std::filesystem::remove(drive_ / "boxes.json");
  const DetectorEvaluation result =
      evaluate_detector(maps::Drive::open(drive_), options_, true, {}, cancel_);
  EXPECT_FALSE(result.boxes);
  EXPECT_DOUBLE_EQ(result.points->movable.rate(), 1.0);
  const auto json = nlohmann::json::parse(to_json(result));
  EXPECT_TRUE(json["AP"].is_null());
  EXPECT_THAT(to_html(result, {}), HasSubstr("image/png"));
}

TEST_F(EvaluateDetector, CountsPointsOfBoxesAsABuildGrowsThemToo) {
  label_the_car(252, 40);
  for (auto& [scan, boxes] : found_.by_scan)
    for (maps::Box& box : boxes) box.size_m.array() -= 0.1;
  const DetectorEvaluation result = evaluate();
  EXPECT_EQ(result.build_margin_m, 0.1);
  EXPECT_GT(result.points_as_built->movable.count, result.points->movable.count);
  const auto json = nlohmann::json::parse(to_json(result));
  EXPECT_EQ(json["points"]["as_built"]["margin_m"], 0.1);
}

TEST_F(EvaluateDetector, WritesAPageOfItsOwn) {
  options_.detector = "geometric";
  const std::string page = to_html(evaluate(true), {.drive = "a<b>", .command = "x & y"});
  EXPECT_THAT(page, HasSubstr("a&lt;b&gt;"));
  EXPECT_THAT(page, HasSubstr("x &amp; y"));
  EXPECT_THAT(page, HasSubstr("image/png"));
  EXPECT_THAT(page, Not(HasSubstr("<script")));
  EXPECT_THAT(page, Not(HasSubstr("nan")));
}

TEST_F(EvaluateDetector, RefusesWhatItCannotJudge) {
  (void)evaluate();
  std::filesystem::remove(drive_ / "boxes.json");
  const maps::Drive drive = maps::Drive::open(drive_);
  const auto judge = [&] { (void)evaluate_detector(drive, options_, false, {}, cancel_); };
  EXPECT_THAT(judge, ThrowsSaying<InputError>({drive_.string(), "without labels", "boxes.json"}));
  options_.selection.begin = 4;
  EXPECT_THAT(judge, ThrowsSaying<InputError>({drive_.string(), "none selected"}));
  options_.max_range_m = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(judge, ThrowsSaying<std::invalid_argument>({"max_range_m", "nan"}));
  options_ = {};
  options_.detector = "magic";
  EXPECT_THAT(judge, ThrowsSaying<std::invalid_argument>({"magic"}));
}

TEST_F(EvaluateDetector, EndsWhenCancelled) {
  cancel_ = true;
  EXPECT_THROW((void)evaluate(), Cancelled);
}

TEST(PointTally, RefusesLabelsThatAreNoClasses) {
  maps::Scan scan;
  scan.source = "a.bin";
  scan.cloud.positions = {{1.0F, 2.0F, 3.0F}};
  scan.points_in_file = 1;
  EXPECT_THAT([&] { (void)classes_of(scan, {7}); }, ThrowsSaying<InputError>({"a.bin", "label 7"}));
}

TEST(BoxFigures, TracksCountAlikeHoweverLongTheyAreSeen) {
  const auto car_at = [](double x, int track) {
    maps::Box box;
    box.centre = {x, 5.0, -1.0};
    box.size_m = {4.0, 2.0, 1.5};
    box.object_class = maps::ObjectClass::kCar;
    box.track = track;
    return TruthBox{box, 60};
  };
  std::vector<ScanBoxes> scans(3);
  for (ScanBoxes& scan : scans) scan.truths = {car_at(10.0, 1)};
  scans[0].truths.push_back(car_at(20.0, 2));
  scans[0].truths.push_back(car_at(30.0, -1));
  scans[1].truths.push_back(car_at(30.0, -1));
  for (ScanBoxes& scan : scans) {
    scan.found = {scan.truths[0].box};
    scan.in_sight = {1};
  }
  const BoxDetection boxes = box_figures(scans, 50.0);
  const CentreRecall& recall = boxes.classes.front().well_seen;
  EXPECT_EQ(recall.found.count, 3U);
  EXPECT_EQ(recall.found.of, 6U);
  ASSERT_EQ(recall.tracks.size(), 4U);
  EXPECT_DOUBLE_EQ(recall.by_track(), 0.25);
}

}  // namespace detector_evaluation_test
}  // namespace stillmap::mapping

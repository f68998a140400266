#include "evaluation/detector/box_matching.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "evaluation/detector/precision_recall.hpp"

namespace stillmap::mapping {
namespace box_matching_test {

using maps::ObjectClass;
using ::testing::ElementsAre;
using enum Verdict;

maps::Box car_at(double x, double y, double score = 1.0) {
  maps::Box box;
  box.centre = {x, y, -1.0};
  box.size_m = {4.0, 2.0, 1.5};
  box.object_class = ObjectClass::kCar;
  box.score = score;
  return box;
}

ScanBoxes scan_of(std::vector<TruthBox> truths, std::vector<maps::Box> found) {
  ScanBoxes scan;
  scan.truths = std::move(truths);
  scan.found = std::move(found);
  scan.in_sight.assign(scan.found.size(), 1);
  return scan;
}

const ClassGroup& vehicle() { return kinds()[0]; }

TEST(BoxMatching, AnOverlapIsEnoughJustWhereTheAreasSay) {
  // Moved by 1 m of 4 m: 6 of 10 m^2 are shared.
  const ScanBoxes scan = scan_of({{car_at(10, 5), 100}}, {car_at(11, 5)});
  EXPECT_THAT(match_by_overlap(scan, vehicle(), {}, 0.5999).verdicts, ElementsAre(kTrue));
  EXPECT_THAT(match_by_overlap(scan, vehicle(), {}, 0.6001).verdicts, ElementsAre(kFalse));
}

TEST(BoxMatching, TheBetterScoreTakesTheLabelAndASecondBoxIsFalse) {
  // The second box lies better, but is less certain.
  const ScanBoxes scan =
      scan_of({{car_at(10, 5), 100}}, {car_at(10.5, 5, 0.9), car_at(10, 5, 0.4)});
  const ScanMatch match = match_by_overlap(scan, vehicle(), {}, 0.5);
  EXPECT_THAT(match.verdicts, ElementsAre(kTrue, kFalse));
  EXPECT_THAT(match.is_found, ElementsAre(1));
  // By centres the nearest is the one.
  EXPECT_THAT(match_by_centre(scan, vehicle(), {}).verdicts, ElementsAre(kFalse, kTrue));
}

TEST(BoxMatching, CentresMayBeOneAndAHalfMetresApart) {
  const ScanBoxes near = scan_of({{car_at(10, 5), 100}}, {car_at(10.9, 6.19)});
  EXPECT_THAT(match_by_centre(near, vehicle(), {}).is_found, ElementsAre(1));
  const ScanBoxes far = scan_of({{car_at(10, 5), 100}}, {car_at(10.9, 6.21)});
  EXPECT_THAT(match_by_centre(far, vehicle(), {}).is_found, ElementsAre(0));
  EXPECT_THAT(match_by_centre(far, vehicle(), {}).verdicts, ElementsAre(kFalse));
}

TEST(BoxMatching, NearestPairsComeFirst) {
  // Taken in order, the first label would take the box of the second.
  const ScanBoxes scan =
      scan_of({{car_at(10, 5), 100}, {car_at(11.2, 5), 100}}, {car_at(11.1, 5), car_at(8.8, 5)});
  EXPECT_THAT(match_by_centre(scan, vehicle(), {}).is_found, ElementsAre(1, 1));
}

TEST(BoxMatching, OnALabelThatDoesNotCountABoxSaysNothing) {
  maps::Box misc = car_at(20, -5);
  misc.object_class = ObjectClass::kUnknown;
  const ScanBoxes scan =
      scan_of({{car_at(10, 5), 4}, {misc, 100}, {car_at(51, 0), 100}},
              {car_at(10.3, 5), car_at(20, -5), car_at(49.8, 0), car_at(52, 10), car_at(0, 9)});
  const std::vector<Verdict> expected{kIgnored, kIgnored, kIgnored, kIgnored, kFalse};
  for (const ScanMatch& match :
       {match_by_overlap(scan, vehicle(), {}, 0.3), match_by_centre(scan, vehicle(), {})}) {
    EXPECT_EQ(match.verdicts, expected);
    EXPECT_THAT(match.counts, ElementsAre(0, 0, 0));
  }
}

TEST(BoxMatching, ALabelOfAnotherKindDoesNotExcuseABox) {
  maps::Box walker = car_at(10, 5);
  walker.object_class = ObjectClass::kPedestrian;
  const ScanBoxes scan = scan_of({{walker, 100}}, {car_at(10, 5)});
  EXPECT_THAT(match_by_overlap(scan, vehicle(), {}, 0.3).verdicts, ElementsAre(kFalse));
  EXPECT_THAT(match_by_centre(scan, vehicle(), {}).verdicts, ElementsAre(kFalse));
  EXPECT_THAT(match_by_centre(scan, kinds()[2], {}).verdicts, ElementsAre(kOther));
}

TEST(BoxMatching, AVanFoundAsACarIsAFoundVehicleButNoFoundVan) {
  maps::Box van = car_at(10, 5);
  van.object_class = ObjectClass::kVan;
  const ScanBoxes scan = scan_of({{van, 100}}, {car_at(10, 5)});
  EXPECT_THAT(match_by_overlap(scan, vehicle(), {}, 0.7).verdicts, ElementsAre(kTrue));
  for (const ClassGroup& single : single_classes()) {
    const ScanMatch match = match_by_overlap(scan, single, {}, 0.3);
    EXPECT_THAT(match.verdicts, ElementsAre(single.name == "car" ? kFalse : kOther));
    EXPECT_THAT(match.is_found, ElementsAre(0));
    EXPECT_EQ(&kind_of(single),
              single.name == "cyclist" || single.name == "motorcycle" ? &kinds()[1] : &vehicle());
  }
}

TEST(BoxMatching, OutOfSightABoxIsFalseOnlyWhereALabelSaysOtherwise) {
  ScanBoxes scan = scan_of({{car_at(10, 5), 100}}, {car_at(10, 5), car_at(-10, 5)});
  scan.in_sight = {0, 0};
  EXPECT_THAT(match_by_centre(scan, vehicle(), {}).verdicts, ElementsAre(kTrue, kIgnored));
}

TEST(BoxMatching, ScoresBelowTheThresholdAreLeftOut) {
  const ScanBoxes scan = scan_of({{car_at(10, 5), 100}}, {car_at(10, 5, 0.29), car_at(30, 5, 0.3)});
  const ScanMatch match = match_by_centre(scan, vehicle(), {}, 0.3);
  EXPECT_THAT(match.verdicts, ElementsAre(kOther, kFalse));
  EXPECT_THAT(match.is_found, ElementsAre(0));
}

/// A camera at the lidar that looks along +x: 100 px of focal length, 200 x 100 px.
maps::CameraView camera() {
  maps::CameraView view;
  view.P_image_lidar << 100, -100, 0, 0, 50, 0, -100, 0, 1, 0, 0, 0;
  view.size_px = {200.0, 100.0};
  return view;
}

TEST(BoxMatching, ACameraLabelsWhatItsImageHoldsTheCentreOf) {
  const auto cube_at = [](double x, double y) {
    maps::Box cube = car_at(x, y);
    cube.centre.z() = 0.0;
    cube.size_m = {1.0, 1.0, 1.0};
    return cube;
  };
  EXPECT_TRUE(would_be_labelled(cube_at(10, 0), camera()));
  EXPECT_TRUE(would_be_labelled(cube_at(10, 9.9), camera()));
  EXPECT_FALSE(would_be_labelled(cube_at(10, 10.1), camera()));
  EXPECT_FALSE(would_be_labelled(cube_at(10, -10.1), camera()));
  EXPECT_FALSE(would_be_labelled(cube_at(-10, 0), camera()));
}

TEST(BoxMatching, HalfInARegionWithoutLabelsIsUnlabelled) {
  maps::Box plate = car_at(10, 0);
  plate.centre.z() = 0.0;
  plate.size_m = {1e-6, 2.0, 2.0};  // pixels 90 to 110 by 40 to 60
  maps::CameraView view = camera();
  view.dont_care = {{0.0, 0.0, 99.0, 100.0}};
  EXPECT_TRUE(would_be_labelled(plate, view));
  view.dont_care = {{0.0, 0.0, 101.0, 100.0}};
  EXPECT_FALSE(would_be_labelled(plate, view));
}

TEST(PrecisionRecall, PerfectBoxesHaveOne) {
  const std::vector<ScanBoxes> scans{scan_of({{car_at(10, 5), 100}, {car_at(20, 5), 100}},
                                             {car_at(10, 5, 0.9), car_at(20, 5, 0.2)}),
                                     scan_of({{car_at(10, 5), 100}}, {car_at(10, 5, 0.5)})};
  EXPECT_DOUBLE_EQ(average_precision(scans, vehicle(), {}, 0.7).value, 1.0);
}

TEST(PrecisionRecall, IsTheMeanOfTheBestPrecisionsByHand) {
  // True 0.9, false 0.8, true 0.7, and a second box of it 0.6; four labels.
  const std::vector<ScanBoxes> scans{scan_of(
      {{car_at(10, 5), 100}, {car_at(20, 5), 100}, {car_at(30, 5), 100}, {car_at(40, 5), 100}},
      {car_at(10, 5, 0.9), car_at(10, -20, 0.8), car_at(20, 5, 0.7), car_at(20.1, 5, 0.6)})};
  const AveragePrecision ap = average_precision(scans, vehicle(), {}, 0.5);
  ASSERT_EQ(ap.curve.size(), 4U);
  EXPECT_DOUBLE_EQ(ap.curve[2].recall, 0.5);
  EXPECT_DOUBLE_EQ(ap.curve[2].precision, 2.0 / 3.0);
  EXPECT_DOUBLE_EQ(ap.curve[3].precision, 0.5);
  // Recalls to 1/4 with precision 1, to 1/2 with 2/3, then nothing.
  EXPECT_NEAR(ap.value, (10 * 1.0 + 10 * 2.0 / 3.0) / 40.0, 1e-12);
}

TEST(PrecisionRecall, BoxesOfOneScoreAreOneStep) {
  const std::vector<ScanBoxes> one{
      scan_of({{car_at(10, 5), 100}}, {car_at(10, 5, 0.5), car_at(30, 5, 0.5)})};
  const std::vector<ScanBoxes> other{
      scan_of({{car_at(10, 5), 100}}, {car_at(30, 5, 0.5), car_at(10, 5, 0.5)})};
  for (const auto& scans : {one, other}) {
    const AveragePrecision ap = average_precision(scans, vehicle(), {}, 0.5);
    ASSERT_EQ(ap.curve.size(), 1U);
    EXPECT_DOUBLE_EQ(ap.value, 0.5);
  }
}

TEST(PrecisionRecall, NothingFoundIsZeroAndNothingToFindIsUnknown) {
  EXPECT_EQ(average_precision({scan_of({{car_at(10, 5), 100}}, {})}, vehicle(), {}, 0.5).value,
            0.0);
  EXPECT_TRUE(
      std::isnan(average_precision({scan_of({}, {car_at(10, 5)})}, vehicle(), {}, 0.5).value));
  EXPECT_TRUE(std::isnan(average_precision({}, vehicle(), {}, 0.5).value));
}

}  // namespace box_matching_test
}  // namespace stillmap::mapping

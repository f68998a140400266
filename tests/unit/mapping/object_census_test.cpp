#include "build/object_census.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace stillmap::mapping {
namespace {

maps::MapObject seen(std::size_t scan, double x, int track = -1, double y = 0.0) {
  maps::MapObject object;
  object.scan = scan;
  object.centre_map = {x, y, 0.0};
  object.track = track;
  return object;
}

void expect_census(const std::vector<maps::MapObject>& objects, std::size_t parked,
                   std::size_t moving, std::size_t brief) {
  const ObjectCensus census = census_of(objects);
  EXPECT_EQ(census.parked, parked);
  EXPECT_EQ(census.moving, moving);
  EXPECT_EQ(census.brief, brief);
}

TEST(ObjectCensus, OfNothingIsZero) { expect_census({}, 0, 0, 0); }

TEST(ObjectCensus, CallsParkedWhatStaysWithinAMetre) {
  expect_census({seen(0, 5.0), seen(1, 5.8), seen(2, 4.9), seen(3, 5.1)}, 1, 0, 0);
}

TEST(ObjectCensus, CallsMovingWhatGoesFartherInStepsBelowTheGate) {
  expect_census({seen(0, 0.0), seen(1, 2.0), seen(2, 4.0), seen(3, 6.0)}, 0, 1, 0);
}

TEST(ObjectCensus, CallsBriefWhatIsSeenTwice) {
  expect_census({seen(0, 5.0), seen(1, 5.0)}, 0, 0, 1);
}

TEST(ObjectCensus, PartsWhatIsFartherApartThanTheGate) {
  expect_census({seen(0, 0.0), seen(1, 3.0), seen(2, 6.0)}, 0, 0, 3);
}

TEST(ObjectCensus, GivesATrackOneBoxAScan) {
  expect_census(
      {seen(0, 0.0), seen(0, 1.5), seen(1, 0.0), seen(1, 1.5), seen(2, 0.0), seen(2, 1.5)}, 2, 0,
      0);
}

TEST(ObjectCensus, BridgesFiveMissedScansButNotSix) {
  // Another object far away makes the scans between known.
  const auto census_after = [](std::size_t again) {
    std::vector<maps::MapObject> objects;
    for (std::size_t scan = 0; scan <= again + 1; ++scan) {
      objects.push_back(seen(scan, 100.0));
      if (scan == 0 || scan >= again) objects.push_back(seen(scan, 0.0));
    }
    return census_of(objects);
  };
  EXPECT_EQ(census_after(5).parked, 2U);
  EXPECT_EQ(census_after(6).parked, 1U);
  EXPECT_EQ(census_after(6).brief, 2U);
}

TEST(ObjectCensus, FollowsTrackNumbersAcrossAnyDistance) {
  expect_census({seen(0, 0.0, 4), seen(1, 30.0, 4), seen(9, 60.0, 4)}, 0, 1, 0);
}

TEST(ObjectCensus, NeverJoinsDifferentTrackNumbersNorNumberedWithUnnumbered) {
  expect_census({seen(0, 0.0, 1), seen(1, 0.0, 2), seen(2, 0.0)}, 0, 0, 3);
}

}  // namespace
}  // namespace stillmap::mapping

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/edits.hpp>

#include <stdexcept>
#include <string>
#include <vector>

#include "fusion/apply_edits.hpp"
#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace apply_edits_test {

using test::IsNearVector;
using test::ThrowsSaying;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

FusedObject object_at(double x, double y, const std::vector<std::size_t>& scans,
                      maps::ObjectClass object_class = maps::ObjectClass::kCar) {
  FusedObject object;
  object.object_class = object_class;
  object.existence = 0.9;
  for (const std::size_t scan : scans) {
    maps::Box box;
    box.centre = {x, y, 0.5};
    box.size_m = {4.0, 2.0, 1.5};
    object.placements.push_back({scan, box, true});
  }
  return object;
}

/// Two drives of five scans each, all around the origin but for the last one of each.
std::vector<EditScan> ten_scans() {
  std::vector<EditScan> scans;
  for (std::size_t i = 0; i < 10; ++i) {
    scans.push_back({i < 5 ? "north" : "south", i % 5, Eigen::Vector3d::Zero()});
    if (i % 5 == 4) scans.back().sensor.x() = 500.0;
  }
  return scans;
}

maps::Edit keep_car_at(double x, double y) {
  maps::Edit edit;
  edit.object = maps::EditObject{{x, y, 0.5}, maps::ObjectClass::kCar};
  return edit;
}

maps::Edit edit_region(maps::EditAction action, double x, double y) {
  maps::Edit edit;
  edit.action = action;
  edit.box = maps::Box{};
  edit.box->centre = {x, y, 0.5};
  edit.box->size_m = {6.0, 6.0, 4.0};
  return edit;
}

std::vector<std::size_t> scans_of(const FusedObject& object) {
  std::vector<std::size_t> scans;
  for (const ObjectPlacement& placement : object.placements) scans.push_back(placement.scan);
  return scans;
}

TEST(ApplyEdits, KeepsTheObjectThatStandsWhereItStood) {
  FusedObjects fused;
  fused.objects = {object_at(0.0, 0.0, {0, 1}), object_at(5.0, 0.0, {0, 1}),
                   object_at(0.0, 0.0, {6})};
  // The rebuild found it 0.6 m off, and on the other day too.
  const EditResult report = apply_edits(fused, {keep_car_at(0.6, 0.0)}, ten_scans());
  EXPECT_EQ(report.applied, 1U);
  EXPECT_THAT(report.unmatched, IsEmpty());
  EXPECT_THAT(report.kept, SizeIs(2));
  ASSERT_THAT(fused.objects, SizeIs(1));
  EXPECT_EQ(fused.objects[0].placements[0].box.centre.x(), 5.0);
  EXPECT_EQ(fused.objects[0].placements[0].box.track, 0);
}

TEST(ApplyEdits, KeepsByClassAndScope) {
  FusedObjects fused;
  fused.objects = {object_at(0.0, 0.0, {0, 1}, maps::ObjectClass::kPedestrian),
                   object_at(0.0, 0.0, {0, 6}, maps::ObjectClass::kVan)};
  maps::Edit edit = keep_car_at(0.0, 0.0);
  edit.scope.drive = "south";
  const EditResult report = apply_edits(fused, {edit}, ten_scans());
  EXPECT_EQ(report.applied, 1U);
  ASSERT_THAT(fused.objects, SizeIs(2));
  EXPECT_THAT(scans_of(fused.objects[0]), ElementsAre(0, 1));
  // A van was a car to another build; only the day that was named is kept.
  EXPECT_THAT(scans_of(fused.objects[1]), ElementsAre(0));
}

TEST(ApplyEdits, AStandingObjectComesBeforeOneThatDrivesBy) {
  FusedObject moving = object_at(0.0, 0.0, {2});
  moving.moving = true;
  FusedObjects fused;
  fused.objects = {moving, object_at(0.3, 0.0, {2, 3})};
  static_cast<void>(apply_edits(fused, {keep_car_at(0.0, 0.0)}, ten_scans()));
  ASSERT_THAT(fused.objects, SizeIs(1));
  EXPECT_TRUE(fused.objects[0].moving);
}

TEST(ApplyEdits, KeepsWhatStandsInARegion) {
  FusedObjects fused;
  fused.objects = {object_at(0.0, 0.0, {0}), object_at(2.9, 0.0, {1}), object_at(3.1, 0.0, {1})};
  const std::vector<EditScan> scans = ten_scans();
  const maps::Edits edits{edit_region(maps::EditAction::kKeep, 0.0, 0.0)};
  const EditResult report = apply_edits(fused, edits, scans);
  EXPECT_EQ(report.applied, 1U);
  ASSERT_THAT(fused.objects, SizeIs(1));
  EXPECT_EQ(fused.objects[0].placements[0].box.centre.x(), 3.1);
  EXPECT_THAT(kept_regions(edits, scans[0]), SizeIs(1));
}

TEST(ApplyEdits, KeptRegionsAreThoseOfTheScan) {
  maps::Edit edit = edit_region(maps::EditAction::kKeep, 0.0, 0.0);
  edit.scope = {"north", std::pair<std::size_t, std::size_t>{1, 2}};
  const maps::Edits edits{edit, edit_region(maps::EditAction::kRemove, 0.0, 0.0)};
  const std::vector<EditScan> scans = ten_scans();
  EXPECT_THAT(kept_regions(edits, scans[0]), IsEmpty());
  EXPECT_THAT(kept_regions(edits, scans[1]), SizeIs(1));
  EXPECT_THAT(kept_regions(edits, scans[6]), IsEmpty());
}

TEST(ApplyEdits, RemovesARegionInEveryScanNearIt) {
  FusedObjects fused;
  maps::Edit edit = edit_region(maps::EditAction::kRemove, 10.0, 0.0);
  edit.scope.drive = "north";
  const EditResult report = apply_edits(fused, {edit}, ten_scans());
  EXPECT_EQ(report.applied, 1U);
  ASSERT_THAT(fused.objects, SizeIs(1));
  EXPECT_EQ(fused.objects[0].existence, 1.0);
  EXPECT_THAT(scans_of(fused.objects[0]), ElementsAre(0, 1, 2, 3));
  EXPECT_THAT(fused.objects[0].placements[0].box.size_m,
              IsNearVector(Eigen::Vector3d(6.0, 6.0, 4.0), 0.0));
}

TEST(ApplyEdits, RemovesADoubtfulObjectAfterAll) {
  FusedObjects fused;
  fused.doubtful = {object_at(0.0, 0.0, {0, 1})};
  maps::Edit edit = keep_car_at(0.2, 0.0);
  edit.action = maps::EditAction::kRemove;
  const EditResult report = apply_edits(fused, {edit}, ten_scans());
  EXPECT_EQ(report.applied, 1U);
  ASSERT_THAT(fused.objects, SizeIs(1));
  EXPECT_EQ(fused.objects[0].existence, 1.0);
  EXPECT_THAT(scans_of(fused.objects[0]), ElementsAre(0, 1));
}

TEST(ApplyEdits, TheLastWordIsTheLaterEdit) {
  FusedObjects fused;
  const EditResult report = apply_edits(fused,
                                        {edit_region(maps::EditAction::kRemove, 0.0, 0.0),
                                         edit_region(maps::EditAction::kKeep, 0.0, 0.0)},
                                        ten_scans());
  EXPECT_EQ(report.applied, 2U);
  EXPECT_THAT(fused.objects, IsEmpty());
}

TEST(ApplyEdits, WhatMetNothingIsSaid) {
  FusedObjects fused;
  fused.objects = {object_at(0.0, 0.0, {0})};
  maps::Edit elsewhere = edit_region(maps::EditAction::kRemove, 0.0, 0.0);
  elsewhere.scope.drive = "west";
  const EditResult report = apply_edits(fused, {keep_car_at(1.2, 0.0), elsewhere}, ten_scans());
  EXPECT_EQ(report.applied, 0U);
  EXPECT_THAT(report.unmatched, ElementsAre("edits[0]: keep car at (1.2, 0.0, 0.5)",
                                            HasSubstr("edits[1]: remove region")));
  EXPECT_THAT(fused.objects, SizeIs(1));
}

TEST(ApplyEdits, RefusesPlacementsOfUnknownScans) {
  FusedObjects fused;
  fused.objects = {object_at(0.0, 0.0, {10})};
  EXPECT_THROW(static_cast<void>(apply_edits(fused, {}, ten_scans())), std::invalid_argument);
}

}  // namespace apply_edits_test
}  // namespace stillmap::mapping

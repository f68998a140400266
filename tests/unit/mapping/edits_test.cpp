#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/edits.hpp>
#include <stillmap/maps/error.hpp>

#include <stdexcept>
#include <string>
#include <vector>

#include "fusion/apply_edits.hpp"
#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace {

using test::IsNearVector;
using test::ThrowsSaying;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

std::string file_of(const std::string& edits) {
  return R"({"format": "stillmap-edits", "version": 1, "edits": [)" + edits + "]}";
}

Edits read(const std::string& text) {
  const test::TemporaryFolder folder;
  return read_edits(folder.write("edits.json", text));
}

TEST(Edits, AreReadWithRegionsObjectsAndScopes) {
  const Edits edits = read(file_of(R"(
      {"action": "keep", "object": {"centre": [3, 4, 0.5], "class": "car"}},
      {"action": "remove", "box": {"centre": [-1.5, 2, 0], "size": [4, 2, 3], "yaw": 0.25},
       "drive": "north", "scans": [120, 180], "note": "a skip"})"));
  ASSERT_THAT(edits, SizeIs(2));
  EXPECT_EQ(edits[0].action, EditAction::kKeep);
  ASSERT_TRUE(edits[0].object && !edits[0].box);
  EXPECT_THAT(edits[0].object->centre, IsNearVector(Eigen::Vector3d(3.0, 4.0, 0.5), 0.0));
  EXPECT_EQ(edits[0].object->object_class, maps::ObjectClass::kCar);
  EXPECT_TRUE(edits[0].scope.holds("any", 7));
  EXPECT_EQ(edits[0].description(), "keep car at (3.0, 4.0, 0.5)");
  EXPECT_EQ(edits[1].action, EditAction::kRemove);
  ASSERT_TRUE(edits[1].box && !edits[1].object);
  EXPECT_THAT(edits[1].box->size_m, IsNearVector(Eigen::Vector3d(4.0, 2.0, 3.0), 0.0));
  EXPECT_EQ(edits[1].box->yaw_rad, 0.25);
  EXPECT_TRUE(edits[1].scope.holds("north", 120));
  EXPECT_TRUE(edits[1].scope.holds("north", 180));
  EXPECT_FALSE(edits[1].scope.holds("north", 181));
  EXPECT_FALSE(edits[1].scope.holds("south", 150));
}

TEST(Edits, NoneAreFine) { EXPECT_THAT(read(file_of("")), IsEmpty()); }

TEST(Edits, AreRefusedByFileAndKey) {
  const auto refused = [](const std::string& text, const std::vector<std::string>& says) {
    EXPECT_THAT([&] { static_cast<void>(read(text)); }, ThrowsSaying<maps::InputError>(says))
        << text;
  };
  const auto edit = [](const std::string& members) { return file_of("{" + members + "}"); };
  const std::string box = R"("box": {"centre": [0, 0, 0], "size": [1, 1, 1], "yaw": 0})";
  refused("{", {"edits.json", "JSON"});
  refused("[]", {"edits.json", "an object"});
  refused(R"({"format": "other", "version": 1, "edits": []})", {".format", "stillmap-edits"});
  refused(R"({"format": "stillmap-edits", "version": 2, "edits": []})", {".version", "found 2"});
  refused(R"({"format": "stillmap-edits", "version": 1})", {".edits", "nothing"});
  refused(R"({"format": "stillmap-edits", "version": 1, "edits": {}})", {".edits", "an array"});
  refused(R"({"format": "stillmap-edits", "version": 1, "edits": [], "more": 1})", {"more"});
  refused(file_of("3"), {".edits[0]", "an object"});
  refused(edit(R"("action": "move", )" + box), {".edits[0].action", "keep or remove"});
  refused(edit(R"("action": "keep")"), {".edits[0]", "either"});
  refused(edit(R"("action": "keep", "object": {"centre": [0, 0, 0], "class": "car"}, )" + box),
          {".edits[0]", "either"});
  refused(edit(R"("action": "keep", "colour": 1, )" + box), {"colour"});
  refused(edit(R"("action": "keep", "scans": [1, 2], )" + box), {".scans", "drive"});
  refused(edit(R"("action": "keep", "drive": "d", "scans": [2, 1], )" + box), {".scans"});
  refused(edit(R"("action": "keep", "drive": "d", "scans": [1], )" + box), {".scans"});
  refused(edit(R"("action": "keep", "drive": "d", "scans": [-1, 2], )" + box), {".scans[0]"});
  refused(edit(R"("action": "keep", "drive": 4, )" + box), {".drive", "a text"});
  refused(edit(R"("action": "keep", "box": {"centre": [0, 0], "size": [1, 1, 1], "yaw": 0})"),
          {".box.centre", "three numbers"});
  refused(edit(R"("action": "keep", "box": {"centre": [0, 0, 0], "size": [1, 0, 1], "yaw": 0})"),
          {".box.size", "> 0"});
  refused(
      edit(R"("action": "remove", "box": {"centre": [0, 0, 0], "size": [201, 1, 1], "yaw": 0})"),
      {".box.size", "200 m to remove"});
  refused(edit(R"("action": "keep", "box": {"centre": [0, 0, 0], "size": [1, 1, 1]})"),
          {".box.yaw", "nothing"});
  refused(
      edit(R"("action": "keep", "box": {"centre": [0, 0, 1e999], "size": [1, 1, 1], "yaw": 0})"),
      {"edits.json"});
  refused(edit(R"("action": "keep", "object": {"centre": [0, 0, 0], "class": "tree"})"),
          {".object.class", "\"tree\"", "car"});
}

TEST(Edits, OfAFileThatIsNotThereSaySo) {
  const test::TemporaryFolder folder;
  EXPECT_THAT([&] { static_cast<void>(read_edits(folder.path() / "none.json")); },
              ThrowsSaying<maps::StorageError>({"none.json"}));
}

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

Edit keep_car_at(double x, double y) {
  Edit edit;
  edit.object = EditObject{{x, y, 0.5}, maps::ObjectClass::kCar};
  return edit;
}

Edit edit_region(EditAction action, double x, double y) {
  Edit edit;
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
  const EditReport report = apply_edits(fused, {keep_car_at(0.6, 0.0)}, ten_scans());
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
  Edit edit = keep_car_at(0.0, 0.0);
  edit.scope.drive = "south";
  const EditReport report = apply_edits(fused, {edit}, ten_scans());
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
  const Edits edits{edit_region(EditAction::kKeep, 0.0, 0.0)};
  const EditReport report = apply_edits(fused, edits, scans);
  EXPECT_EQ(report.applied, 1U);
  ASSERT_THAT(fused.objects, SizeIs(1));
  EXPECT_EQ(fused.objects[0].placements[0].box.centre.x(), 3.1);
  EXPECT_THAT(kept_regions(edits, scans[0]), SizeIs(1));
}

TEST(ApplyEdits, KeptRegionsAreThoseOfTheScan) {
  Edit edit = edit_region(EditAction::kKeep, 0.0, 0.0);
  edit.scope = {"north", std::pair<std::size_t, std::size_t>{1, 2}};
  const Edits edits{edit, edit_region(EditAction::kRemove, 0.0, 0.0)};
  const std::vector<EditScan> scans = ten_scans();
  EXPECT_THAT(kept_regions(edits, scans[0]), IsEmpty());
  EXPECT_THAT(kept_regions(edits, scans[1]), SizeIs(1));
  EXPECT_THAT(kept_regions(edits, scans[6]), IsEmpty());
}

TEST(ApplyEdits, RemovesARegionInEveryScanNearIt) {
  FusedObjects fused;
  Edit edit = edit_region(EditAction::kRemove, 10.0, 0.0);
  edit.scope.drive = "north";
  const EditReport report = apply_edits(fused, {edit}, ten_scans());
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
  Edit edit = keep_car_at(0.2, 0.0);
  edit.action = EditAction::kRemove;
  const EditReport report = apply_edits(fused, {edit}, ten_scans());
  EXPECT_EQ(report.applied, 1U);
  ASSERT_THAT(fused.objects, SizeIs(1));
  EXPECT_EQ(fused.objects[0].existence, 1.0);
  EXPECT_THAT(scans_of(fused.objects[0]), ElementsAre(0, 1));
}

TEST(ApplyEdits, TheLastWordIsTheLaterEdit) {
  FusedObjects fused;
  const EditReport report = apply_edits(
      fused, {edit_region(EditAction::kRemove, 0.0, 0.0), edit_region(EditAction::kKeep, 0.0, 0.0)},
      ten_scans());
  EXPECT_EQ(report.applied, 2U);
  EXPECT_THAT(fused.objects, IsEmpty());
}

TEST(ApplyEdits, WhatMetNothingIsSaid) {
  FusedObjects fused;
  fused.objects = {object_at(0.0, 0.0, {0})};
  Edit elsewhere = edit_region(EditAction::kRemove, 0.0, 0.0);
  elsewhere.scope.drive = "west";
  const EditReport report = apply_edits(fused, {keep_car_at(1.2, 0.0), elsewhere}, ten_scans());
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

}  // namespace
}  // namespace stillmap::mapping

#include <gmock/gmock.h>
#include <stillmap/maps/edits.hpp>
#include <stillmap/maps/error.hpp>

#include <string>
#include <vector>

#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace edits_test {

using test::IsNearVector;
using test::ThrowsSaying;
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
  EXPECT_EQ(edits[0].object->object_class, ObjectClass::kCar);
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
    EXPECT_THAT([&] { static_cast<void>(read(text)); }, ThrowsSaying<InputError>(says)) << text;
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
              ThrowsSaying<StorageError>({"none.json"}));
}

TEST(Edits, OfATextAreNamedAsTheCallerSays) {
  EXPECT_THAT(parse_edits(kNoEdits, "here"), IsEmpty());
  EXPECT_THAT([] { static_cast<void>(parse_edits("[]", "options.edits")); },
              ThrowsSaying<InputError>({"options.edits", "an object"}));
}

}  // namespace edits_test
}  // namespace stillmap::maps

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/scan_file.hpp>

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <numbers>
#include <string>

#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace box_file_test {

using ::stillmap::test::IsNearVector;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::testing::ElementsAre;
using ::testing::Pair;

// Camera x = -lidar y, y = -lidar z - 0.1, z = lidar x - 0.3.
constexpr const char* kCalibration =
    "P0: 1 0 0 0 0 1 0 0 0 0 1 0\n"
    "R0_rect: 1 0 0 0 1 0 0 0 1\n"
    "Tr_velo_to_cam: 0 -1 0 0  0 0 -1 -0.1  1 0 0 -0.3\n";
constexpr const char* kCar = "3 7 Car 0 0 0.0 10 20 30 40 1.5 1.6 4.0 2.0 1.6 9.7 0.3\n";

std::string text_of(const std::filesystem::path& file) {
  std::ifstream stream(file);
  return {std::istreambuf_iterator<char>(stream), {}};
}

TEST(BoxFile, TurnsAKittiLabelToTheLidarFrame) {
  const TemporaryFolder folder;
  folder.write("calib.txt", kCalibration);
  const BoxSequence boxes = read_boxes(folder.write("label.txt", kCar), 10);
  ASSERT_EQ(boxes.by_scan.size(), 1U);
  const Box& box = boxes.by_scan.at(3).at(0);
  EXPECT_THAT(box.centre, IsNearVector(Eigen::Vector3d(10.0, -2.0, -0.95), 1e-12));
  EXPECT_THAT(box.size_m, IsNearVector(Eigen::Vector3d(4.0, 1.6, 1.5), 0.0));
  EXPECT_NEAR(box.yaw_rad, -std::numbers::pi / 2.0 - 0.3, 1e-12);
  EXPECT_EQ(box.object_class, ObjectClass::kCar);
  EXPECT_EQ(box.track, 7);
  EXPECT_EQ(box.score, 1.0);
}

TEST(BoxFile, UsesTheRectification) {
  const TemporaryFolder folder;
  // Rectified x = y, y = -x of the camera frame above.
  folder.write("calib.txt",
               "R_rect 0 1 0 -1 0 0 0 0 1\nTr_velo_cam 0 -1 0 0  0 0 -1 -0.1  1 0 0 -0.3\n");
  const BoxSequence boxes = read_boxes(folder.write("label.txt", kCar), 10);
  // Rectified centre (2, 0.85, 9.7) is camera (-0.85, 2, 9.7), thus lidar (10, 0.85, -2.1).
  EXPECT_THAT(boxes.by_scan.at(3).at(0).centre,
              IsNearVector(Eigen::Vector3d(10.0, 0.85, -2.1), 1e-12));
}

TEST(BoxFile, FindsTheCalibrationOfARawDateFolder) {
  const TemporaryFolder folder;
  folder.write("date/calib_cam_to_cam.txt", "S_00: 1 2\nR_rect_00: 1 0 0 0 1 0 0 0 1\n");
  folder.write("date/calib_velo_to_cam.txt",
               "calib_time: 15-Mar-2012 11:37:16\nR: 0 -1 0 0 0 -1 1 0 0\nT: 0 -0.1 -0.3\n");
  const BoxSequence boxes = read_boxes(folder.write("date/drive/tracking/label.txt", kCar), 10);
  EXPECT_THAT(boxes.by_scan.at(3).at(0).centre,
              IsNearVector(Eigen::Vector3d(10.0, -2.0, -0.95), 1e-12));
}

TEST(BoxFile, CountsWhatItLeavesOut) {
  const TemporaryFolder folder;
  folder.write("calib.txt", kCalibration);
  const std::string dont_care = "0 -1 DontCare -1 -1 -10 1 2 3 4 -1000 -1000 -1000 -10 -1 -1 -1\n";
  const std::string not_finite = "2 8 Car 0 0 0 1 2 3 4 1.5 1.6 4 nan 1.6 9.7 0\n";
  const auto file = folder.write("label.txt", kCar + dont_care + dont_care + not_finite);
  EXPECT_THAT(read_boxes(file, 10).dropped,
              ElementsAre(Pair("DontCare", 2), Pair("not finite", 1)));
  const BoxSequence short_drive = read_boxes(file, 3);
  EXPECT_EQ(short_drive.dropped.at("frame beyond the drive"), 1U);
  EXPECT_TRUE(short_drive.by_scan.empty());
}

TEST(BoxFile, NamesLineAndValueOfABadLabel) {
  const TemporaryFolder folder;
  folder.write("calib.txt", kCalibration);
  const auto refuses = [&](const std::string& line, const std::string& found) {
    const auto file = folder.write("label.txt", kCar + line);
    EXPECT_THAT([&] { (void)read_boxes(file, 10); },
                ThrowsSaying<InputError>({file.string(), "2", found}))
        << line;
  };
  refuses("4 1 Car 0 0 0 1 2 3 4 1.5 1.6 4 2 1.6 9.7\n", "16 fields");
  refuses("4 1 Car 0 0 0 1 2 3 4 1.5 1.6 4 2 1.6 9.7 0 1 1\n", "19 fields");
  refuses("4 1 Car 0 0 0 1 2 3 4 1.5 wide 4 2 1.6 9.7 0\n", "wide");
  refuses("4 1 Ufo 0 0 0 1 2 3 4 1.5 1.6 4 2 1.6 9.7 0\n", "Ufo");
  refuses("-4 1 Car 0 0 0 1 2 3 4 1.5 1.6 4 2 1.6 9.7 0\n", "-4");
  refuses("4 1.5 Car 0 0 0 1 2 3 4 1.5 1.6 4 2 1.6 9.7 0\n", "1.5");
  refuses("4 1 Car 0 0 0 1 2 3 4 0 1.6 4 2 1.6 9.7 0\n", "0.0");
  refuses("4 1 Car 0 0 0 1 2 3 4 1.5 1.6 4 2 1.6 9.7 0 1.2\n", "1.2");
}

TEST(BoxFile, RefusesAMissingOrBrokenCalibration) {
  const TemporaryFolder folder;
  const auto file = folder.write("a/b/c/d/label.txt", kCar);
  const auto refuses = [&](const std::string& found) {
    EXPECT_THAT([&] { (void)read_boxes(file, 10); }, ThrowsSaying<InputError>({found}));
  };
  refuses("calib.txt");
  folder.write("a/b/c/d/calib.txt", "R0_rect: 1 0 0 0 1 0 0 0 1\n");
  refuses("Tr_velo_to_cam");
  folder.write("a/b/c/d/calib.txt", "R0_rect: 1 0 0 0 1 0 0 0\n");
  refuses("8 numbers");
  folder.write("a/b/c/d/calib.txt",
               "R0_rect: 1 0 0 0 1 0 0 0 1\nTr_velo_to_cam: 0 0 0 0 0 0 0 0 0 0 0 0\n");
  refuses("determinant");
}

TEST(BoxFile, ReadsBackWhatItWrites) {
  BoxSequence written;
  Box box;
  box.centre = {1.0 / 3.0, -2.25, 0.1};
  box.size_m = {4.1, 1.7, 1.5};
  box.yaw_rad = -0.7;
  box.object_class = ObjectClass::kVan;
  box.score = 0.25;
  box.track = 12;
  written.by_scan[2] = {box, box};
  written.by_scan[5] = {};
  const TemporaryFolder folder;
  const auto file = folder.path() / "boxes.json";
  write_boxes(file, written);
  const BoxSequence read = read_boxes(file, 6);
  ASSERT_EQ(read.by_scan.size(), 2U);
  ASSERT_EQ(read.by_scan.at(2).size(), 2U);
  const Box& same = read.by_scan.at(2)[1];
  EXPECT_EQ(same.centre, box.centre);
  EXPECT_EQ(same.size_m, box.size_m);
  EXPECT_EQ(same.yaw_rad, box.yaw_rad);
  EXPECT_EQ(same.object_class, box.object_class);
  EXPECT_EQ(same.score, box.score);
  EXPECT_EQ(same.track, box.track);
  EXPECT_EQ(read_boxes(file, 2).dropped.at("frame beyond the drive"), 2U);
  const std::string first = text_of(file);
  write_boxes(file, read);
  EXPECT_EQ(text_of(file), first);
}

TEST(BoxFile, NamesThePathOfABadJsonValue) {
  const TemporaryFolder folder;
  const auto refuses = [&](const std::string& box, const std::string& path) {
    const auto file = folder.write(
        "boxes.json",
        R"({"format":"stillmap-boxes","version":1,"scans":[{"scan":0,"boxes":[)" + box + "]}]}");
    EXPECT_THAT([&] { (void)read_boxes(file, 10); },
                ThrowsSaying<InputError>({file.string(), path}))
        << box;
  };
  refuses(R"({"centre":[1,2],"size":[1,1,1],"yaw":0,"class":"car"})", ".scans[0].boxes[0].centre");
  refuses(R"({"centre":[1,2,3],"size":[1,-1,1],"yaw":0,"class":"car"})", ".boxes[0].size");
  refuses(R"({"centre":[1,2,3],"size":[201,1,1],"yaw":0,"class":"car"})", "at most 200 m");
  refuses(R"({"centre":[1,2,3],"size":[1,1,1],"yaw":1e9,"class":"car"})", ".yaw");
  refuses(R"({"centre":[1,2,3],"size":[1,1,1],"yaw":0,"class":"ufo"})", "ufo");
  refuses(R"({"centre":[1,2,3],"size":[1,1,1],"yaw":0,"class":"car","score":2})", ".score");
  refuses(R"({"centre":[1,2,3],"size":[1,1,1],"yaw":0})", ".class");
  refuses(R"({"centre":[1,2,)", "JSON");
  EXPECT_THAT([&] { (void)read_boxes(folder.write("b.json", R"({"format":"other"})"), 1); },
              ThrowsSaying<InputError>({"other", "stillmap-boxes"}));
}

TEST(BoxFile, RealLabelsHoldTheScansPoints) {
  const char* data = std::getenv("STILLMAP_REAL_DATA");
  if (data == nullptr) GTEST_SKIP() << "STILLMAP_REAL_DATA is not set";
  const auto drive =
      std::filesystem::path(data) / "kitti_raw/2011_09_26/2011_09_26_drive_0013_sync";
  const BoxSequence boxes = read_boxes(drive / "tracking/label_02.txt", 1000);
  EXPECT_EQ(boxes.dropped, (std::map<std::string, std::size_t>{{"DontCare", 285}}));
  std::size_t count = 0;
  for (const auto& [scan, of_scan] : boxes.by_scan) count += of_scan.size();
  EXPECT_EQ(count, 225U);

  // Of all points around a car at bumper height and above, nearly all must lie in its box.
  const PointCloud cloud = read_scan_file(drive / "velodyne_points/data/0000000000.bin").cloud;
  const Box& car = boxes.by_scan.at(0).at(0);
  std::size_t inside = 0;
  std::size_t around = 0;
  for (const Eigen::Vector3f& p : cloud.positions) {
    const Eigen::Vector3d q = p.cast<double>();
    if (q.z() < car.centre.z() - 0.3 * car.size_m.z()) continue;
    inside += car.contains(q, 0.1) ? 1 : 0;
    around += car.contains(q, 0.6) ? 1 : 0;
  }
  std::printf("car of scan 0: %zu of %zu points around it lie in its box\n", inside, around);
  EXPECT_GT(inside, 500U);
  EXPECT_GT(static_cast<double>(inside), 0.97 * static_cast<double>(around));
}

}  // namespace box_file_test
}  // namespace stillmap::maps

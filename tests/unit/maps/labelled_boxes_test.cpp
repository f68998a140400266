#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/labelled_boxes.hpp>

#include <cstdlib>
#include <string>

#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace labelled_boxes_test {

using ::stillmap::test::IsNearVector;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;

// Camera x = -lidar y, y = -lidar z - 0.1, z = lidar x - 0.3.
constexpr const char* kCalibration =
    "P2: 721.5377 0 600 0 0 721.5377 170 0 0 0 1 0\n"
    "R0_rect: 1 0 0 0 1 0 0 0 1\n"
    "Tr_velo_to_cam: 0 -1 0 0  0 0 -1 -0.1  1 0 0 -0.3\n";
constexpr const char* kCar = "Car 0.1 0 0.0 10 20 30 40 1.5 1.6 4.0 2.0 1.6 9.7 0.3\n";
constexpr const char* kRegion = "DontCare -1 -1 -10 1 2 3 4.5 -1 -1 -1 -1000 -1000 -1000 -10\n";

class LabelledBoxesTest : public ::testing::Test {
 protected:
  LabelledBoxesTest() {
    for (const char* const name : {"000005", "000007"})
      folder_.write(std::string("drive/velodyne/") + name + ".bin", std::string(16, '\1'));
  }
  [[nodiscard]] std::optional<LabelledBoxes> read() const {
    return read_labelled_boxes(Drive::open(folder_.path() / "drive"));
  }
  void write_object(const std::string& name, const std::string& labels,
                    const std::string& calibration = kCalibration) {
    folder_.write("drive/label_2/" + name + ".txt", labels);
    folder_.write("drive/calib/" + name + ".txt", calibration);
  }

  TemporaryFolder folder_;
};

TEST_F(LabelledBoxesTest, AFolderWithoutLabelsHasNone) { EXPECT_FALSE(read()); }

TEST_F(LabelledBoxesTest, ReadsOneLabelFileAScanByName) {
  write_object("000005", kRegion);
  write_object("000007", std::string(kCar) + kRegion);
  const LabelledBoxes labels = *read();
  ASSERT_EQ(labels.boxes.by_scan.size(), 1U);
  const Box& box = labels.boxes.by_scan.at(1).at(0);
  EXPECT_THAT(box.centre, IsNearVector(Eigen::Vector3d(10.0, -2.0, -0.95), 1e-12));
  EXPECT_EQ(box.track, -1);
  EXPECT_EQ(labels.boxes.dropped.at("DontCare"), 2U);
  ASSERT_EQ(labels.views.size(), 2U);
  const CameraView& view = labels.views.at(0);
  EXPECT_EQ(view.size_px, Eigen::Vector2d(1242.0, 375.0));
  ASSERT_EQ(view.dont_care.size(), 1U);
  EXPECT_DOUBLE_EQ(view.dont_care[0].area(), 5.0);
  // Straight ahead of the camera is the principal point.
  const Eigen::Vector3d h = view.P_image_lidar * Eigen::Vector4d(10.3, 0.0, -0.1, 1.0);
  EXPECT_THAT(Eigen::Vector3d(h / h.z()), IsNearVector(Eigen::Vector3d(600.0, 170.0, 1.0), 1e-9));
  EXPECT_NEAR(h.z(), 10.0, 1e-12);
}

TEST_F(LabelledBoxesTest, TrackingLabelsAndOurOwnComeFirst) {
  write_object("000005", kCar);
  write_object("000007", kCar);
  folder_.write("drive/tracking/calib.txt", kCalibration);
  folder_.write("drive/tracking/label_02.txt",
                std::string("1 -1 ") + kRegion + "0 3 " + kCar + "1 3 " + kCar);
  const LabelledBoxes tracking = *read();
  EXPECT_EQ(tracking.boxes.by_scan.at(1).at(0).track, 3);
  EXPECT_TRUE(tracking.views.at(0).dont_care.empty());
  EXPECT_EQ(tracking.views.at(1).dont_care.size(), 1U);
  write_boxes(folder_.path() / "drive/boxes.json", {});
  const LabelledBoxes own = *read();
  EXPECT_TRUE(own.views.empty());
  EXPECT_TRUE(own.boxes.by_scan.empty());
}

TEST_F(LabelledBoxesTest, TakesSizeAndLensOfARawDateFolder) {
  folder_.write("calib_velo_to_cam.txt", "R: 0 -1 0 0 0 -1 1 0 0\nT: 0 -0.1 -0.3\n");
  folder_.write("calib_cam_to_cam.txt",
                "R_rect_00: 1 0 0 0 1 0 0 0 1\nS_rect_02: 640 480\n"
                "P_rect_02: 500 0 320 0 0 500 240 0 0 0 1 0\n");
  folder_.write("drive/tracking/label_02.txt", std::string("0 3 ") + kCar);
  EXPECT_EQ(read()->views.at(0).size_px, Eigen::Vector2d(640.0, 480.0));
  folder_.write("calib_cam_to_cam.txt",
                "R_rect_00: 1 0 0 0 1 0 0 0 1\nS_rect_02: 640 0\n"
                "P_rect_02: 500 0 320 0 0 500 240 0 0 0 1 0\n");
  EXPECT_THAT([&] { (void)read(); },
              ThrowsSaying<InputError>({"calib_cam_to_cam.txt", "0 in S_rect_02"}));
}

TEST_F(LabelledBoxesTest, NamesWhatIsMissingOrWrong) {
  write_object("000005", kCar);
  EXPECT_THAT([&] { (void)read(); }, ThrowsSaying<InputError>({"000007.txt", "no labels"}));
  write_object("000007", std::string("0 3 ") + kCar);
  EXPECT_THAT([&] { (void)read(); }, ThrowsSaying<InputError>({"000007.txt", "17 fields", "15"}));
  write_object("000007", "DontCare -1 -1 -10 5 2 3 4 -1 -1 -1 -1000 -1000 -1000 -10\n");
  EXPECT_THAT([&] { (void)read(); }, ThrowsSaying<InputError>({"000007.txt", "line 1", "region"}));
  std::string other = kCalibration;
  other.replace(other.find("721.5377"), 8, "700.0000");
  write_object("000007", kCar, other);
  EXPECT_THAT([&] { (void)read(); }, ThrowsSaying<InputError>({"000007.txt", "focal length"}));
  other = kCalibration;
  other.replace(other.find(" 600 "), 5, " 1e308 ");
  write_object("000007", kCar, other);
  EXPECT_THAT([&] { (void)read(); }, ThrowsSaying<InputError>({"000007.txt", "1e+308 in P2"}));
  other = kCalibration;
  other.replace(other.find("-0.3"), 4, "1e308");
  write_object("000007", kCar, other);
  EXPECT_THAT([&] { (void)read(); }, ThrowsSaying<InputError>({"000007.txt", "1e+308 m apart"}));
  write_object("000007", kCar, "R0_rect: 1 0 0 0 1 0 0 0 1\n");
  EXPECT_THAT([&] { (void)read(); }, ThrowsSaying<InputError>({"000007.txt", "Tr_velo_to_cam"}));
}

TEST_F(LabelledBoxesTest, ReadsTheRealObjectFolder) {
  const char* data = std::getenv("STILLMAP_REAL_DATA");
  if (data == nullptr) GTEST_SKIP() << "STILLMAP_REAL_DATA is not set";
  const auto labels =
      read_labelled_boxes(Drive::open(std::filesystem::path(data) / "kitti_object/training"));
  ASSERT_TRUE(labels);
  EXPECT_EQ(labels->boxes.by_scan.at(1).size(), 3U);
  EXPECT_EQ(labels->views.at(0).size_px, Eigen::Vector2d(1224.0, 370.0));
  EXPECT_EQ(labels->views.at(1).dont_care.size(), 4U);
}

}  // namespace labelled_boxes_test
}  // namespace stillmap::maps

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/scan_file.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <numbers>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "output/drive_writer.hpp"
#include "output/motion_compensation.hpp"
#include "output/oxts_model.hpp"
#include "output/tracking_labels.hpp"
#include "sensing/sensor.hpp"
#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::simulation {
namespace writer_test {

namespace fs = std::filesystem;

constexpr double kRadPerDeg = std::numbers::pi / 180.0;
constexpr std::size_t kScans = 3;
constexpr double kPeriodS = 0.1;
constexpr double kWallX = 250.0;

/// 15 m/s around a bend of 50 m, swaying a little.
Eigen::Isometry3d path(double time_s) {
  constexpr double kSpeed = 15.0;
  constexpr double kRadius = 50.0;
  const double yaw = kSpeed * time_s / kRadius;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() =
      Eigen::Vector3d(200.0 + kRadius * std::sin(yaw), -100.0 + kRadius * (1.0 - std::cos(yaw)),
                      6.73 + 0.05 * std::sin(9.0 * time_s));
  T.linear() = (Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                Eigen::AngleAxisd(0.02 + 0.01 * std::sin(5.0 * time_s), Eigen::Vector3d::UnitY()) *
                Eigen::AngleAxisd(0.02 * std::cos(3.0 * time_s), Eigen::Vector3d::UnitX()))
                   .toRotationMatrix();
  return T;
}

/// What the sensor measures of a wall across the world's x axis, as far as its rays meet it.
SimulatedScan wall_scan(std::size_t index, Sensor& sensor) {
  SimulatedScan scan;
  scan.stamp_s = kPeriodS * static_cast<double>(index);
  for (const Beam& beam : sensor.beams(index)) {
    const Eigen::Isometry3d T = path(scan.stamp_s + static_cast<double>(beam.time_s));
    const Eigen::Vector3d ray = T.linear() * beam.direction.cast<double>();
    const double range = (kWallX - T.translation().x()) / ray.x();
    if (!(range > 1.0 && range < 90.0)) continue;
    LabelledPoints& points = beam.ring == 3 ? scan.behind : scan.points;
    points.positions.push_back((range * beam.direction.cast<double>()).cast<float>());
    points.intensities.push_back(0.25F);
    points.labels.push_back(50U + (7U << kInstanceShift));
    points.time_offsets_s.push_back(beam.time_s);
    points.rings.push_back(beam.ring);
  }
  maps::Box car{{12.0, 3.0, -0.9}, {4.2, 1.8, 1.5}, 0.3, maps::ObjectClass::kCar, 1.0, 7};
  scan.boxes_at_stamp = {car};
  car.centre.x() += 0.25;
  scan.boxes = {car};
  return scan;
}

Mesh ground() {
  Mesh mesh;
  mesh.add_quad({150, -150, 5}, {250, -150, 5}, {250, -50, 5}, {150, -50, 5}, Surface::kAsphalt);
  return mesh;
}

std::string text_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

template <typename Number>
std::vector<Number> numbers_in(const fs::path& file) {
  const std::string bytes = text_of(file);
  std::vector<Number> numbers(bytes.size() / sizeof(Number));
  std::memcpy(numbers.data(), bytes.data(), numbers.size() * sizeof(Number));
  return numbers;
}

DriveWriterOptions options_of(OutputLayout layout) {
  DriveWriterOptions options;
  options.layout = layout;
  options.key = 5;
  return options;
}

/// Writes a drive and says what `Drive::open` takes.
fs::path write_drive(const fs::path& target, OutputLayout layout,
                     const std::string& sensor_name = "vlp16", std::size_t scans = kScans) {
  DriveWriter writer(target, options_of(layout), path);
  const auto sensor = make_sensor(sensor_name);
  for (std::size_t i = 0; i < scans; ++i) writer.add(wall_scan(i, *sensor));
  writer.publish(ground());
  return layout == OutputLayout::kKittiRaw ? target / "2026_06_01_drive_0001_sync" : target;
}

std::string stem_of(const maps::Drive& drive, std::size_t index) {
  return drive.contents().scan_files[index].stem().string();
}

void expect_same_box(const maps::Box& box, const maps::Box& expected, double tolerance_m) {
  EXPECT_THAT(box.centre, test::IsNearVector(expected.centre, tolerance_m));
  EXPECT_THAT(box.size_m, test::IsNearVector(expected.size_m, tolerance_m));
  EXPECT_NEAR(std::remainder(box.yaw_rad - expected.yaw_rad, 2.0 * std::numbers::pi), 0.0, 1e-4);
  EXPECT_EQ(box.object_class, expected.object_class);
  EXPECT_EQ(box.track, expected.track);
}

class WrittenDrive : public ::testing::TestWithParam<OutputLayout> {
 protected:
  [[nodiscard]] bool at_stamp() const { return GetParam() == OutputLayout::kKittiOdometry; }
  [[nodiscard]] std::vector<Eigen::Vector3f> expected(const SimulatedScan& scan,
                                                      const LabelledPoints& points) const {
    return at_stamp() ? positions_at_stamp(path, scan.stamp_s, points) : points.positions;
  }

  test::TemporaryFolder folder_;
  fs::path root_ = write_drive(folder_.path() / "drive", GetParam());
};

TEST_P(WrittenDrive, ReadsBackPointsStampsAndLabels) {
  const maps::Drive drive = maps::Drive::open(root_);
  const auto sensor = make_sensor("vlp16");
  ASSERT_EQ(drive.size(), kScans);
  ASSERT_TRUE(drive.has_poses());
  for (std::size_t i = 0; i < kScans; ++i) {
    const SimulatedScan scan = wall_scan(i, *sensor);
    const std::vector<Eigen::Vector3f> positions = expected(scan, scan.points);
    const maps::Scan read = drive.read(i);
    ASSERT_GT(positions.size(), 5000U);
    EXPECT_EQ(read.cloud.positions, positions);
    EXPECT_EQ(read.cloud.intensities, scan.points.intensities);
    EXPECT_EQ(drive.stamp_ns(i) - drive.stamp_ns(0), static_cast<std::int64_t>(i) * 100'000'000);
    EXPECT_EQ(numbers_in<std::uint32_t>(root_ / "labels" / (stem_of(drive, i) + ".label")),
              scan.points.labels);
    if (at_stamp()) {
      EXPECT_TRUE(read.cloud.time_offsets_s.empty());
      EXPECT_EQ(drive.read_labels(i), scan.points.labels);
      continue;
    }
    ASSERT_EQ(read.cloud.time_offsets_s.size(), positions.size());
    for (std::size_t k = 0; k < positions.size(); ++k) {
      ASSERT_NEAR(read.cloud.time_offsets_s[k], scan.points.time_offsets_s[k], 1e-5F);
    }
  }
}

TEST_P(WrittenDrive, HasBoxesInTheFrameOfItsPoints) {
  const maps::BoxSequence boxes = maps::read_boxes(root_ / "boxes.json", kScans);
  ASSERT_EQ(boxes.by_scan.size(), kScans);
  const SimulatedScan scan = wall_scan(0, *make_sensor("vlp16"));
  const maps::Box& expected_box = at_stamp() ? scan.boxes_at_stamp[0] : scan.boxes[0];
  for (const auto& [index, of_scan] : boxes.by_scan) {
    ASSERT_EQ(of_scan.size(), 1U);
    expect_same_box(of_scan[0], expected_box, 1e-9);
  }
  if (GetParam() == OutputLayout::kPcd) return;
  const maps::BoxSequence tracks = maps::read_boxes(root_ / "tracking" / "label_02.txt", kScans);
  ASSERT_EQ(tracks.by_scan.size(), kScans);
  expect_same_box(tracks.by_scan.at(2)[0], expected_box, 1e-4);
}

TEST_P(WrittenDrive, KnowsTheTruth) {
  const maps::Drive drive = maps::Drive::open(root_);
  const auto sensor = make_sensor("vlp16");
  const fs::path truth = root_ / "truth";
  const maps::Trajectory trajectory = maps::read_tum_trajectory(truth / "trajectory.txt");
  EXPECT_EQ(trajectory.size(), 301U);
  EXPECT_EQ(trajectory.poses()[0].stamp_ns, drive.stamp_ns(0) - 50'000'000);
  const Eigen::Isometry3d T_map_world =
      trajectory.at(drive.stamp_ns(0)).value() * path(0.0).inverse();
  for (std::size_t i = 0; i < kScans; ++i) {
    const SimulatedScan scan = wall_scan(i, *sensor);
    const std::string stem = stem_of(drive, i);
    EXPECT_EQ(numbers_in<float>(truth / "times" / (stem + ".bin")), scan.points.time_offsets_s);
    const maps::DecodedScan behind = maps::read_scan_file(truth / "behind" / (stem + ".bin"));
    ASSERT_GT(behind.cloud.size(), 100U);
    EXPECT_EQ(behind.cloud.positions, expected(scan, scan.behind));
    EXPECT_EQ(numbers_in<std::uint32_t>(truth / "behind" / (stem + ".label")), scan.behind.labels);
    EXPECT_THAT(trajectory.at(drive.stamp_ns(i)).value(),
                test::IsNearPose(T_map_world * path(scan.stamp_s), 1e-6, 1e-6));
    const bool has_errors = GetParam() == OutputLayout::kKittiRaw;
    EXPECT_THAT(drive.T_map_lidar(i),
                test::IsNearPose(trajectory.at(drive.stamp_ns(i)).value(), has_errors ? 0.3 : 1e-3,
                                 (has_errors ? 0.5 : 0.01) * kRadPerDeg));
  }
  const maps::DecodedScan ply = maps::read_scan_file(truth / "ground.ply");
  ASSERT_EQ(ply.cloud.size(), 4U);
  EXPECT_THAT(
      ply.cloud.positions[2].cast<double>(),
      test::IsNearVector(Eigen::Vector3d(T_map_world * Eigen::Vector3d(250, -50, 5)), 1e-3));
  const std::string bytes = text_of(truth / "ground.ply");
  constexpr std::size_t kFaceBytes = 1 + 3 * 4 + 4;
  std::int32_t label = 0;
  std::memcpy(&label, bytes.data() + bytes.size() - sizeof(label), sizeof(label));
  EXPECT_EQ(label, 40);
  EXPECT_EQ(bytes.size() - bytes.find("end_header\n") - 11, 4U * 12U + 2U * kFaceBytes);
  EXPECT_TRUE(fs::exists(truth / "README.md"));
}

TEST_P(WrittenDrive, IsTheSameForTheSameKey) {
  const fs::path again = folder_.path() / "again";
  write_drive(again, GetParam());
  std::size_t files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder_.path() / "drive")) {
    if (!entry.is_regular_file()) continue;
    ++files;
    const fs::path name = fs::relative(entry.path(), folder_.path() / "drive");
    EXPECT_EQ(text_of(entry.path()), text_of(again / name)) << name;
  }
  EXPECT_GT(files, 15U);
}

TEST_P(WrittenDrive, HasNoTruthUnlessAsked) {
  DriveWriterOptions options = options_of(GetParam());
  options.truth = false;
  const fs::path target = folder_.path() / "plain";
  const auto sensor = make_sensor("vlp16");
  DriveWriter writer(target, options, path);
  writer.add(wall_scan(0, *sensor));
  writer.publish(ground());
  for (const auto& entry : fs::recursive_directory_iterator(target)) {
    EXPECT_NE(entry.path().filename(), "truth");
  }
}

TEST_P(WrittenDrive, ShowsNothingBeforeItIsPublished) {
  const fs::path target = folder_.path() / "unpublished";
  {
    DriveWriter writer(target, options_of(GetParam()), path);
    writer.add(wall_scan(0, *make_sensor("vlp16")));
    EXPECT_FALSE(fs::exists(target));
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), fs::directory_iterator()), 1);
}

TEST_P(WrittenDrive, RefusesATargetThatExistsOrCannotBeWritten) {
  EXPECT_THROW(DriveWriter(folder_.path() / "drive", options_of(GetParam()), path),
               maps::InputError);
  EXPECT_THROW(DriveWriter(folder_.path() / "none" / "drive", options_of(GetParam()), path),
               maps::StorageError);
}

INSTANTIATE_TEST_SUITE_P(Simulation, WrittenDrive,
                         ::testing::Values(OutputLayout::kKittiOdometry, OutputLayout::kKittiRaw,
                                           OutputLayout::kPcd),
                         [](const auto& layout) {
                           switch (layout.param) {
                             case OutputLayout::kKittiOdometry:
                               return "KittiOdometry";
                             case OutputLayout::kKittiRaw:
                               return "KittiRaw";
                             case OutputLayout::kPcd:
                               return "Pcd";
                           }
                           return "";
                         });

/// Largest distance from the wall of the points of a drive, put where the scan's pose says.
double off_wall_m(const maps::Drive& drive, const Eigen::Isometry3d& T_world_map) {
  double off_m = 0.0;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    for (const Eigen::Vector3f& p : drive.read(i).cloud.positions) {
      const Eigen::Vector3d q = T_world_map * drive.T_map_lidar(i) * p.cast<double>();
      off_m = std::max(off_m, std::abs(q.x() - kWallX));
    }
  }
  return off_m;
}

TEST(DriveWriter, FreesOdometryScansFromTheMotionOfTheSweep) {
  const test::TemporaryFolder folder;
  const fs::path odometry = write_drive(folder.path() / "odometry", OutputLayout::kKittiOdometry);
  const fs::path pcd = write_drive(folder.path() / "pcd", OutputLayout::kPcd);
  EXPECT_LT(off_wall_m(maps::Drive::open(odometry), path(0.0)), 1e-3);
  EXPECT_GT(off_wall_m(maps::Drive::open(pcd), Eigen::Isometry3d::Identity()), 0.3);
}

TEST(DriveWriter, WritesTheSamePosesTwiceInAFolderOfPcd) {
  const test::TemporaryFolder folder;
  const fs::path root = write_drive(folder.path() / "pcd", OutputLayout::kPcd);
  const maps::Drive drive = maps::Drive::open(root);
  EXPECT_EQ(drive.contents().layout, maps::DriveLayout::kKeyframes);
  EXPECT_TRUE(drive.relative_clock());
  const maps::Drive given = maps::Drive::open(root, root / "trajectory.txt");
  for (std::size_t i = 0; i < kScans; ++i) {
    const Eigen::Isometry3d T_true = path(kPeriodS * static_cast<double>(i));
    EXPECT_THAT(drive.T_map_lidar(i), test::IsNearPose(T_true, 1e-3, 0.01 * kRadPerDeg));
    EXPECT_THAT(given.T_map_lidar(i), test::IsNearPose(T_true, 1e-3, 0.01 * kRadPerDeg));
  }
}

TEST(DriveWriter, StartsOdometryPosesAtTheIdentity) {
  const test::TemporaryFolder folder;
  const fs::path root = write_drive(folder.path() / "drive", OutputLayout::kKittiOdometry);
  const maps::Drive drive = maps::Drive::open(root);
  for (std::size_t i = 0; i < kScans; ++i) {
    const double stamp_s = kPeriodS * static_cast<double>(i);
    EXPECT_THAT(drive.T_map_lidar(i),
                test::IsNearPose(path(0.0).inverse() * path(stamp_s), 1e-3, 0.01 * kRadPerDeg));
  }
}

TEST(DriveWriter, ClaimsNoSpinForASensorThatDoesNotSpin) {
  const test::TemporaryFolder folder;
  const fs::path root = write_drive(folder.path() / "drive", OutputLayout::kKittiRaw, "avia");
  EXPECT_FALSE(fs::exists(root / "velodyne_points" / "timestamps_start.txt"));
  const maps::Drive drive = maps::Drive::open(root);
  EXPECT_TRUE(drive.read(0).cloud.time_offsets_s.empty());
  const fs::path hdl = write_drive(folder.path() / "hdl", OutputLayout::kKittiRaw, "hdl64", 1);
  EXPECT_TRUE(fs::exists(hdl / "velodyne_points" / "timestamps_start.txt"));
}

TEST(MotionCompensation, IsUndoneByMovingBack) {
  const SimulatedScan scan = wall_scan(2, *make_sensor("vlp16"));
  const std::vector<Eigen::Vector3f> moved = positions_at_stamp(path, scan.stamp_s, scan.points);
  double most_moved_m = 0.0;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    const double time_s = scan.stamp_s + static_cast<double>(scan.points.time_offsets_s[i]);
    const Eigen::Vector3d back =
        path(time_s).inverse() * path(scan.stamp_s) * moved[i].cast<double>();
    const Eigen::Vector3d p = scan.points.positions[i].cast<double>();
    ASSERT_LT((back - p).norm(), 1e-4);
    most_moved_m = std::max(most_moved_m, (moved[i].cast<double>() - p).norm());
  }
  EXPECT_GT(most_moved_m, 0.3);
  EXPECT_TRUE(positions_at_stamp(path, 0.0, {}).empty());
}

maps::Box box_at(double x, double y, maps::ObjectClass object_class, int track) {
  return {{x, y, -0.8}, {4.0, 1.8, 1.6}, 0.4, object_class, 1.0, track};
}

TEST(TrackingLabels, ComeBackAsTheSameBoxes) {
  using maps::ObjectClass;
  const std::vector<maps::Box> boxes{
      box_at(15.0, 2.0, ObjectClass::kCar, 1),        box_at(30.0, -8.0, ObjectClass::kVan, 2),
      box_at(40.0, 0.0, ObjectClass::kTruck, 3),      box_at(20.0, 9.0, ObjectClass::kCyclist, 4),
      box_at(50.0, 5.0, ObjectClass::kPedestrian, 5), box_at(35.0, 14.0, ObjectClass::kTram, 6)};
  const KittiCamera camera(1.73);
  const test::TemporaryFolder folder;
  folder.write("calib.txt", camera.tracking_calibration());
  const fs::path file = folder.write("label_02.txt", tracking_labels(3, boxes, camera));
  const maps::BoxSequence read = maps::read_boxes(file, 4);
  ASSERT_EQ(read.by_scan.at(3).size(), boxes.size());
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    expect_same_box(read.by_scan.at(3)[i], boxes[i], 0.02);
  }
}

std::vector<std::string> fields_of(const std::string& line) {
  std::istringstream stream(line);
  return {std::istream_iterator<std::string>(stream), {}};
}

TEST(TrackingLabels, LeaveOutWhatTheCameraDoesNotSee) {
  using maps::ObjectClass;
  const KittiCamera camera(1.73);
  EXPECT_EQ(tracking_labels(0, {box_at(-15.0, 0.0, ObjectClass::kCar, 1)}, camera), "");
  EXPECT_EQ(tracking_labels(0, {box_at(10.0, 30.0, ObjectClass::kCar, 1)}, camera), "");
  EXPECT_NE(tracking_labels(0, {box_at(10.0, 3.0, ObjectClass::kCar, 1)}, camera), "");
}

TEST(TrackingLabels, TellTruncationAndOcclusion) {
  using maps::ObjectClass;
  const KittiCamera camera(1.73);
  const auto alone = fields_of(tracking_labels(0, {box_at(30, 0, ObjectClass::kCar, 1)}, camera));
  EXPECT_EQ(alone[3] + alone[4], "00");
  const auto cut = fields_of(tracking_labels(0, {box_at(4, 3, ObjectClass::kCar, 1)}, camera));
  EXPECT_NE(cut[3], "0");
  EXPECT_EQ(std::stod(cut[6]), 0.0);
  const auto hidden = fields_of(tracking_labels(
      0, {box_at(30, 0, ObjectClass::kCar, 1), box_at(12, 0, ObjectClass::kVan, 2)}, camera));
  EXPECT_EQ(hidden[4], "2");
  EXPECT_EQ(hidden[17 + 4], "0");
}

TEST(TrackingLabels, OutlineTheBoxInTheImage) {
  const KittiCamera camera(1.73);
  maps::Box box{{20.27, 0.0, -0.08}, {2.0, 4.0, 2.0}, 0.0, maps::ObjectClass::kCar, 1.0, 1};
  const auto label = fields_of(tracking_labels(0, {box}, camera));
  // Near face 19 m in front of the camera; focal length and middle of P2.
  const double half_width = 721.5377 * 2.0 / 19.0;
  const double left = (721.5377 * -2.0 + 609.5593 * 19.0 + 44.85728) / (19.0 + 0.002745884);
  EXPECT_NEAR(std::stod(label[6]), left, 0.01);
  EXPECT_NEAR(std::stod(label[8]) - std::stod(label[6]), 2.0 * half_width, 0.05);
  EXPECT_NEAR(std::stod(label[16]), -std::numbers::pi / 2.0, 1e-6);
}

TEST(Oxts, ErrorsKeepTheirDeviationAndFadeOverTheirTime) {
  Random random(3);
  DriftingError error(0.1, 60.0);
  double before = error.next(0.0, random);
  double square = 0.0;
  double product = 0.0;
  constexpr int kSteps = 40'000;
  for (int i = 0; i < kSteps; ++i) {
    const double now = error.next(20.0, random);
    square += now * now;
    product += now * before;
    before = now;
  }
  EXPECT_NEAR(std::sqrt(square / kSteps), 0.1, 0.004);
  EXPECT_NEAR(product / square, std::exp(-20.0 / 60.0), 0.02);
}

/// Numbers of a packet.
std::vector<double> packet_of(OxtsModel& oxts, double time_s) {
  std::istringstream stream(oxts.packet(time_s));
  return {std::istream_iterator<double>(stream), {}};
}

TEST(Oxts, ReportsTheMotionOfTheVehicle) {
  OxtsModel oxts(path, Eigen::Isometry3d::Identity(), 1);
  const std::vector<double> n = packet_of(oxts, 1.0);
  ASSERT_EQ(n.size(), 30U);
  const double yaw = 15.0 / 50.0;
  EXPECT_NEAR(n[5], yaw, 0.5 * kRadPerDeg);
  EXPECT_NEAR(n[6], 15.0 * std::sin(yaw), 0.1);  // north
  EXPECT_NEAR(n[7], 15.0 * std::cos(yaw), 0.1);  // east
  EXPECT_NEAR(n[8], 15.0, 0.1);                  // forward
  EXPECT_NEAR(n[9], 0.0, 0.1);                   // to the left
  EXPECT_NEAR(n[15], 15.0 * 15.0 / 50.0, 0.3);   // level, to the left
  EXPECT_NEAR(n[16], 9.81 - 0.05 * 81.0 * std::sin(9.0), 0.3);
  EXPECT_NEAR(n[22], 15.0 / 50.0, 0.01);
  EXPECT_EQ(n[23], 0.1);
  EXPECT_EQ(n[25], 4.0);
}

TEST(Oxts, PosesComeBackWithinTheirStatedErrors) {
  // Independent errors: a drive each, whose later poses are against its first packet.
  double square_m2 = 0.0;
  double square_rad2 = 0.0;
  constexpr std::size_t kDrives = 40;
  constexpr double kLaterS = 200.0;
  for (std::size_t k = 0; k < kDrives; ++k) {
    OxtsModel oxts(path, Eigen::Isometry3d::Identity(), key_of({77, k}));
    EXPECT_THROW((void)oxts.T_map_world(), std::logic_error);
    const std::vector<double> first = packet_of(oxts, 0.0);
    const std::vector<double> later = packet_of(oxts, kLaterS);
    const GeographicLib::LocalCartesian local(first[0], first[1], first[2]);
    Eigen::Vector3d p;
    local.Forward(later[0], later[1], later[2], p.x(), p.y(), p.z());
    const Eigen::Isometry3d T_true = oxts.T_map_world() * path(kLaterS);
    square_m2 += (p - T_true.translation()).head<2>().squaredNorm() / kDrives;
    const double yaw = 15.0 * kLaterS / 50.0;
    square_rad2 += std::pow(std::remainder(later[5] - yaw, 2.0 * std::numbers::pi), 2) / kDrives;
  }
  EXPECT_NEAR(std::sqrt(0.5 * square_m2), OxtsModel::kHorizontalSigmaM, 0.03);
  EXPECT_NEAR(std::sqrt(square_rad2), OxtsModel::kYawSigmaDeg * kRadPerDeg, 0.04 * kRadPerDeg);
}

}  // namespace writer_test
}  // namespace stillmap::simulation

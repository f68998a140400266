// Scans and priors that make no sense: every method says so, in bounded time.
#include "align/query.hpp"
#include "reference/map_points.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/map_package.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/matchers.hpp>
#include <support/synthetic_world.hpp>
#include <support/temporary_folder.hpp>

#include <cmath>
#include <cstdio>
#include <ctime>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace stillmap::localization {
namespace bad_input_test {

using test::pose_at;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr std::size_t kMany = 2'000'000;
const Eigen::Vector3d kMapOrigin(5000.0, -3000.0, 40.0);

test::ScanPattern pattern(std::uint64_t seed) {
  test::ScanPattern out;
  out.columns = 360;
  out.noise_m = 0.02;
  out.seed = seed;
  return out;
}

/// A street as a map package far from the origin, and every method on it.
class Street {
 public:
  Street() {
    std::vector<Eigen::Isometry3d> poses;
    for (double x = 30.0; x <= 90.0; x += 3.0) poses.push_back(pose_at(x, 0.0));
    std::map<maps::TileId, std::vector<maps::MapPoint>> tiles;
    for (const Eigen::Vector3d& p : world_.mapped_from(poses, pattern(50))) {
      const auto tile = [](double c) {
        return static_cast<std::int32_t>(std::floor(c / maps::kTileSizeM));
      };
      tiles[{.level = 0, .x = tile(p.x()), .y = tile(p.y())}].push_back(
          {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()), 0.0F, 1,
           maps::PointKind::kMeasured, 0});
    }
    maps::MapPackageWriter writer(folder_.path() / "street");
    for (const auto& [id, points] : tiles) writer.add_tile(id, points);
    std::vector<maps::StampedPose> trajectory;
    for (const Eigen::Isometry3d& T : poses) {
      trajectory.push_back({.stamp_ns = static_cast<std::int64_t>(trajectory.size()),
                            .T_map_lidar = Eigen::Translation3d(kMapOrigin) * T});
    }
    writer.write_trajectory(maps::Trajectory(std::move(trajectory)));
    maps::MapManifest manifest;
    manifest.frame_id = "map";
    manifest.origin = kMapOrigin;
    manifest.voxel_size_m = 0.1;
    manifest.software_version = "0";
    (void)writer.publish(manifest, "{}");
    const auto map = maps::MapPackage::open(folder_.path() / "street");
    for (const std::string& name : aligner_names()) methods_[name] = make_aligner(name, *map);
  }

  [[nodiscard]] const std::map<std::string, std::unique_ptr<Aligner>>& methods() const {
    return methods_;
  }
  [[nodiscard]] const Eigen::Isometry3d& T_map_lidar() const { return T_map_lidar_; }
  [[nodiscard]] const maps::PointCloud& good_scan() const { return good_scan_; }

 private:
  test::TemporaryFolder folder_;
  test::SyntheticWorld world_ = test::street(31);
  std::map<std::string, std::unique_ptr<Aligner>> methods_;
  maps::PointCloud good_scan_ = world_.scan(pose_at(60.0, 0.5, 0.05), pattern(7));
  Eigen::Isometry3d T_map_lidar_ = Eigen::Translation3d(kMapOrigin) * pose_at(60.0, 0.5, 0.05);
};
const Street& street() {
  static const Street built;
  return built;
}

/// What a query may be answered with.
enum class Expected {
  kThrows,  ///< the documented std::invalid_argument
  kLost,
  kNotOk,
  kOk,  ///< and at the right place
};

void expect_sound(const AlignmentResult& result) {
  EXPECT_TRUE(result.T_map_lidar.matrix().allFinite());
  EXPECT_TRUE(result.covariance.allFinite());
  EXPECT_TRUE(result.inlier_ratio >= 0.0 && result.inlier_ratio <= 1.0) << result.inlier_ratio;
  EXPECT_TRUE(result.rmse_m >= 0.0 && result.rmse_m < 10.0) << result.rmse_m;
  for (const auto& direction : result.degenerate_directions) {
    EXPECT_NEAR(direction.norm(), 1.0, 1e-6);
  }
  const ProtectionLevels& levels = result.protection;
  for (const double level :
       {levels.longitudinal_m, levels.lateral_m, levels.vertical_m, levels.yaw_rad}) {
    EXPECT_TRUE(level > 0.0) << level;
    EXPECT_TRUE(result.status == PoseStatus::kOk || std::isinf(level)) << level;
  }
  EXPECT_EQ(result.reasons.empty(), result.status == PoseStatus::kOk);
  if (result.status == PoseStatus::kLost) return;
  const Eigen::Matrix3d R = result.T_map_lidar.linear();
  EXPECT_LT((R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_GT(R.determinant(), 0.0);
}

/// Asks and keeps the time, for whoever reads the log.
class Asked {
 public:
  ~Asked() { std::printf("slowest: %.0f ms of CPU, %s\n", slowest_ms_, slowest_.c_str()); }

  void expect(const std::string& what, const std::string& method, const maps::PointCloud& scan,
              const std::optional<Prior>& prior, Expected expected) {
    SCOPED_TRACE(what + ", " + method + (prior ? "" : " without a prior"));
    const Aligner& aligner = *street().methods().at(method);
    if (expected == Expected::kThrows) {
      EXPECT_THROW((void)aligner.align(scan, prior), std::invalid_argument);
      return;
    }
    const std::clock_t begin = std::clock();
    const AlignmentResult result = aligner.align(scan, prior);
    const double took_ms = 1e3 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
    if (took_ms > slowest_ms_) {
      slowest_ms_ = took_ms;
      slowest_ = method + " on " + what + (prior ? "" : " without a prior");
    }
    expect_sound(result);
    const auto status = name_of(result.status);
    if (expected == Expected::kOk) {
      EXPECT_EQ(status, "ok") << ::testing::PrintToString(names_of(result.reasons));
      EXPECT_THAT(result.T_map_lidar, test::IsNearPose(street().T_map_lidar(), 0.1, 0.005));
    } else if (expected == Expected::kLost) {
      EXPECT_EQ(status, "lost") << ::testing::PrintToString(names_of(result.reasons));
    } else {
      EXPECT_NE(status, "ok");
    }
  }

 private:
  double slowest_ms_ = 0.0;
  std::string slowest_;
};

maps::PointCloud made(std::size_t count,
                      const std::function<Eigen::Vector3d(test::Random&)>& point) {
  test::Random random(count);
  maps::PointCloud cloud;
  cloud.positions.reserve(count);
  for (std::size_t i = 0; i < count; ++i) cloud.positions.push_back(point(random).cast<float>());
  return cloud;
}

maps::PointCloud random_in(double half_m, std::size_t count) {
  return made(count, [half_m](test::Random& random) {
    const auto one = [&] { return random.uniform(-half_m, half_m); };
    const double x = one(), y = one();
    return Eigen::Vector3d(x, y, one());
  });
}

maps::PointCloud good_with(const Eigen::Vector3f& point) {
  maps::PointCloud cloud = street().good_scan();
  cloud.positions[cloud.size() / 2] = point;
  return cloud;
}

struct ScanCase {
  std::string what;
  maps::PointCloud scan;
  Expected expected;
};

std::vector<ScanCase> tiny_scans() {
  maps::PointCloud first = street().good_scan();
  first.positions.resize(49);
  return {
      {"empty", {}, Expected::kLost},
      {"1 point", made(1, [](auto&) { return Eigen::Vector3d(5.0, 1.0, 0.0); }), Expected::kLost},
      {"49 points of a scan", first, Expected::kLost},
      {"49 random points", random_in(20.0, 49), Expected::kLost},
      {"60 random points", random_in(20.0, 60), Expected::kNotOk}};
}

std::vector<ScanCase> scans_without_shape() {
  const auto at = [](double value) {
    return made(1000, [value](auto&) { return Eigen::Vector3d::Constant(value); });
  };
  return {
      {"zeros", at(0.0), Expected::kLost},
      {"points at 1e-30", at(1e-30), Expected::kLost},
      {"points at 1e-44", at(1e-44), Expected::kLost},
      {"points at 1e30", at(1e30), Expected::kLost},
      {"points at -1e38", at(-1e38), Expected::kLost},
      {"points at 1e19, whose square just overflows", at(1.9e19), Expected::kLost},
      {"all in a level plane",
       made(3000,
            [](test::Random& r) {
              const double x = r.uniform(-40.0, 40.0);
              return Eigen::Vector3d(x, r.uniform(-40.0, 40.0), -1.8);
            }),
       Expected::kNotOk},
      {"all in an upright plane",
       made(3000,
            [](test::Random& r) {
              const double x = r.uniform(-40.0, 40.0);
              return Eigen::Vector3d(x, 8.0, r.uniform(-2.0, 8.0));
            }),
       Expected::kNotOk},
      {"all in a slanted plane",
       made(3000,
            [](test::Random& r) {
              const double x = r.uniform(-40.0, 40.0);
              const double y = r.uniform(-40.0, 40.0);
              return Eigen::Vector3d(x, y, 0.5 * x - 0.7 * y);
            }),
       Expected::kNotOk},
      {"all in a level line",
       made(3000,
            [](test::Random& r) { return Eigen::Vector3d(r.uniform(-60.0, 60.0), 7.0, -1.0); }),
       Expected::kNotOk},
      {"all in an upright line",
       made(3000,
            [](test::Random& r) { return Eigen::Vector3d(6.0, 6.0, r.uniform(-200.0, 200.0)); }),
       Expected::kNotOk}};
}

std::vector<ScanCase> scans_out_of_numbers() {
  std::vector<ScanCase> cases;
  for (const float bad : {kNan, kInfinity, -kInfinity}) {
    for (int axis = 0; axis < 3; ++axis) {
      Eigen::Vector3f point(4.0F, 4.0F, 0.0F);
      point[axis] = bad;
      cases.push_back(
          {"one coordinate " + std::to_string(bad), good_with(point), Expected::kThrows});
    }
  }
  maps::PointCloud only = made(1, [](auto&) { return Eigen::Vector3d::Constant(kNan); });
  cases.push_back({"nothing but NaN", only, Expected::kThrows});
  return cases;
}

std::vector<ScanCase> huge_scans() {
  return {{"2 million equal points",
           made(kMany, [](auto&) { return Eigen::Vector3d(10.0, 3.0, 0.5); }), Expected::kLost},
          {"2 million random points in 120 m", random_in(60.0, kMany), Expected::kNotOk}};
}

void ask_all(const std::vector<ScanCase>& cases) {
  Asked asked;
  for (const ScanCase& each : cases) {
    for (const auto& [name, aligner] : street().methods()) {
      asked.expect(each.what, name, each.scan, Prior{street().T_map_lidar(), std::nullopt},
                   each.expected);
    }
    asked.expect(each.what, "default", each.scan, std::nullopt, each.expected);
  }
}

TEST(BadInput, TinyScansAreLost) { ask_all(tiny_scans()); }

TEST(BadInput, ScansWithoutShapeAreNotOk) { ask_all(scans_without_shape()); }

TEST(BadInput, NumbersThatAreNotFiniteAreRefused) { ask_all(scans_out_of_numbers()); }

TEST(BadInput, HugeScansOfNothingAreNotOk) { ask_all(huge_scans()); }

TEST(BadInput, AsManyPointsAreUsedOfAHugeScanAsOfAnyOther) {
  for (const ScanCase& each : huge_scans()) {
    EXPECT_LE(thin_points(view_of(each.scan)).matched, kMaxQueryPoints) << each.what;
    EXPECT_LE(thinned(each.scan.positions, 0.5).size(), kMaxThinnedPoints) << each.what;
  }
}

TEST(BadInput, PointsThatNoSensorSeesChangeNothing) {
  Asked asked;
  for (const Eigen::Vector3f& far :
       {Eigen::Vector3f(1e30F, 0.0F, 0.0F), Eigen::Vector3f(-600.0F, 0.0F, 0.0F),
        Eigen::Vector3f(1e-30F, 0.0F, 0.0F), Eigen::Vector3f(0.0F, 0.0F, 3e38F)}) {
    for (const auto& [name, aligner] : street().methods()) {
      asked.expect("a point far away", name, good_with(far),
                   Prior{street().T_map_lidar(), std::nullopt}, Expected::kOk);
    }
  }
}

TEST(BadInput, PointsThatComeTenTimesCountOnce) {
  maps::PointCloud scan;
  for (const Eigen::Vector3f& p : street().good_scan().positions) {
    scan.positions.insert(scan.positions.end(), 10, p);
  }
  Asked asked;
  const Prior prior{street().T_map_lidar(), std::nullopt};
  for (const auto& [name, aligner] : street().methods()) {
    asked.expect("ten times each point", name, scan, prior, Expected::kOk);
    const AlignmentResult once = aligner->align(street().good_scan(), prior);
    const AlignmentResult often = aligner->align(scan, prior);
    EXPECT_THAT(often.T_map_lidar, test::IsNearPose(once.T_map_lidar, 1e-3, 1e-4)) << name;
    EXPECT_TRUE(often.covariance.isApprox(once.covariance, 0.02)) << name;
  }
  asked.expect("ten times each point", "default", scan, std::nullopt, Expected::kOk);
}

struct PriorCase {
  std::string what;
  Prior prior;
  Expected expected;
};

std::vector<PriorCase> absurd_poses() {
  const auto moved = [](double x, double y, double z) {
    Prior prior{street().T_map_lidar(), std::nullopt};
    prior.T_map_lidar.translation() = Eigen::Vector3d(x, y, z);
    return prior;
  };
  const auto turned = [](const Eigen::Matrix3d& R) {
    Prior prior{street().T_map_lidar(), std::nullopt};
    prior.T_map_lidar.linear() = R;
    return prior;
  };
  const Eigen::Matrix3d R = street().T_map_lidar().linear();
  const Eigen::Matrix3d flipped =
      Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitX()).toRotationMatrix();
  return {
      {"at 1e9 m", moved(1e9, 0.0, 0.0), Expected::kLost},
      {"at -1e9 m", moved(0.0, -1e9, 0.0), Expected::kLost},
      {"at 1e300 m", moved(1e300, 1e300, 1e300), Expected::kLost},
      {"1e9 m above", moved(kMapOrigin.x() + 60.0, kMapOrigin.y(), 1e9), Expected::kLost},
      {"identity, far outside of the map", {}, Expected::kLost},
      {"at NaN", moved(static_cast<double>(kNan), 0.0, 0.0), Expected::kThrows},
      {"at infinity", moved(0.0, 0.0, static_cast<double>(kInfinity)), Expected::kThrows},
      {"rotation of NaN", turned(Eigen::Matrix3d::Constant(static_cast<double>(kNan))),
       Expected::kThrows},
      {"rotation zero", turned(Eigen::Matrix3d::Zero()), Expected::kThrows},
      {"rotation scaled", turned(1.1 * R), Expected::kThrows},
      {"rotation of 1e200", turned(1e200 * R), Expected::kThrows},
      {"a mirror", turned(-R), Expected::kThrows},
      {"sheared", turned(R + 0.1 * Eigen::Matrix3d::Ones()), Expected::kThrows},
      {"a rotation but for its digits", turned(1.0004 * R), Expected::kOk},
      {"upside down", turned(R * flipped), Expected::kNotOk},
  };
}

std::vector<PriorCase> absurd_covariances() {
  using Matrix = Eigen::Matrix<double, 6, 6>;
  const auto with = [](const Matrix& covariance) {
    return Prior{street().T_map_lidar(), covariance};
  };
  const Matrix I = Matrix::Identity();
  Matrix one_negative = I;
  one_negative(4, 4) = -1e-9;
  Matrix indefinite = I;
  indefinite(0, 1) = indefinite(1, 0) = 2.0;
  Matrix lopsided = I;
  lopsided(0, 5) = 0.9;
  // Its decomposition meets infinity times zero before anything negative.
  Matrix overflowing = I;
  overflowing(0, 0) = 1e-300;
  overflowing(0, 2) = overflowing(2, 0) = 1e300;
  Matrix nan = I;
  nan(0, 5) = static_cast<double>(kNan);
  return {{"covariance zero", with(Matrix::Zero()), Expected::kThrows},
          {"covariance negative", with(-I), Expected::kThrows},
          {"one variance negative", with(one_negative), Expected::kThrows},
          {"covariance indefinite", with(indefinite), Expected::kThrows},
          {"covariance not symmetric", with(lopsided), Expected::kThrows},
          {"covariance overflowing", with(overflowing), Expected::kThrows},
          {"covariance NaN", with(nan), Expected::kThrows},
          {"covariance infinite", with(static_cast<double>(kInfinity) * I), Expected::kThrows},
          {"covariance 1e12", with(1e12 * I), Expected::kOk},
          {"covariance 1e300", with(1e300 * I), Expected::kOk},
          {"covariance 1e-300", with(1e-300 * I), Expected::kOk}};
}

void ask_all(const std::vector<PriorCase>& cases) {
  Asked asked;
  for (const PriorCase& each : cases) {
    for (const auto& [name, aligner] : street().methods()) {
      asked.expect("prior " + each.what, name, street().good_scan(), each.prior, each.expected);
    }
  }
}

TEST(BadInput, AbsurdPriorsAreLostOrRefused) { ask_all(absurd_poses()); }

TEST(BadInput, CovariancesThatAreNoneAreRefused) { ask_all(absurd_covariances()); }

TEST(BadInput, NonsenseOfBothKindsIsNotOk) {
  Asked asked;
  for (const PriorCase& prior : absurd_poses()) {
    // Far from the map a scan is not even looked at.
    if (prior.expected == Expected::kThrows || prior.expected == Expected::kLost) continue;
    for (const ScanCase& scan : scans_without_shape()) {
      for (const auto& [name, aligner] : street().methods()) {
        asked.expect(scan.what + ", prior " + prior.what, name, scan.scan, prior.prior,
                     Expected::kNotOk);
      }
    }
  }
}

}  // namespace bad_input_test
}  // namespace stillmap::localization

#pragma once

#include "service.hpp"
#include "support/stored_packages.hpp"
#include "support/temporary_folder.hpp"

#include <gtest/gtest.h>

#include <stillmap/maps/map_package.hpp>
#include "store/package_store.hpp"

#include <cstring>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::server {

/// Answers with what the test says and remembers what it was asked.
class StubAligner final : public localization::Aligner {
 public:
  localization::AlignmentResult align(
      const maps::PointCloud& scan,
      const std::optional<localization::Prior>& prior) const override {
    last_scan = scan;
    had_prior = prior.has_value();
    last_prior = prior.value_or(localization::Prior{});
    return answer(last_prior);
  }

  /// Stands where the prior says, by default.
  std::function<localization::AlignmentResult(const localization::Prior&)> answer =
      [](const auto& prior) {
        localization::AlignmentResult result;
        result.status = localization::PoseStatus::kOk;
        result.T_map_lidar = prior.T_map_lidar;
        result.covariance.setIdentity();
        result.inlier_ratio = 0.9;
        return result;
      };
  mutable maps::PointCloud last_scan;
  mutable localization::Prior last_prior;
  mutable bool had_prior = false;
};

/// A store with one map, `town`: two tiles, two poses, one object.
class TownStore {
 public:
  TownStore() {
    maps::MapPackageWriter writer(built_.path() / "town");
    const std::vector<maps::MapPoint> near = {point(1.25F, 2.25F, 3.0F), point(4.25F, 5.25F, 6.0F)};
    writer.add_tile({.level = 0, .x = 0, .y = 0}, near);
    writer.add_tile({.level = 0, .x = -1, .y = 0}, std::vector{point(-0.75F, 2.25F, 3.0F)});
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() = Eigen::Vector3d(0.5, 0.0, 0.0);
    writer.write_trajectory(maps::Trajectory(std::vector<maps::StampedPose>{
        {.stamp_ns = 1'000'000'000}, {.stamp_ns = 1'100'000'000, .T_map_lidar = T}}));
    maps::MapObject car;
    car.placements = {{.scan = 7}};
    car.size_m = Eigen::Vector3d(4.0, 1.8, 1.5);
    car.object_class = maps::ObjectClass::kCar;
    car.points_removed = 12;
    writer.write_objects({car});
    maps::MapManifest manifest;
    manifest.frame_id = "map";
    manifest.origin = Eigen::Vector3d(100.0, 200.0, 0.0);
    manifest.voxel_size_m = 0.1;
    manifest.software_version = "0";
    manifest.counts["in"] = 3;
    digest_ = writer.publish(manifest, "{}");
    store_.add("town", version(), built_.path() / "town");
    store_.activate("town", version());
  }

  [[nodiscard]] PackageStore& open() const { return store_; }
  [[nodiscard]] const test::TemporaryFolder& folder() const { return folder_; }
  [[nodiscard]] const std::string& digest() const { return digest_; }
  /// Of the package in the store.
  [[nodiscard]] std::filesystem::path package() const {
    return folder_.path() / "packages" / digest_;
  }
  [[nodiscard]] static std::string version() { return "v1"; }

 private:
  static maps::MapPoint point(float x, float y, float z) {
    return {.x = x,
            .y = y,
            .z = z,
            .intensity = 0.5F,
            .observations = 3,
            .kind = maps::PointKind::kMeasured,
            .object = 0};
  }

  test::TemporaryFolder built_;
  test::TemporaryFolder folder_{test::memory_folder()};
  mutable PackageStore store_{folder_.path()};
  std::string digest_;
};

/// A service over `town` with a stub for the aligner, ready when the test begins.
class ServiceTest : public ::testing::Test {
 protected:
  /// Starts the service, by default with one worker and no queue.
  void start(AlignerBuilder builder, const std::vector<WebAsset>& web = {}) {
    service_ = std::make_unique<Service>(options_, store_.open(), std::move(builder), web, mapper_);
  }
  void start() {
    start([this](const maps::MapPackage&, const localization::LocalizationOptions&) {
      return Aligners{{"default", aligner_}};
    });
    wait_until_loaded();
  }
  void wait_until_loaded() {
    while (get("/readyz").status != 200) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }

  HttpResponse get(const std::string& path) const { return service_->handle(request("GET", path)); }

  static HttpRequest request(const std::string& method, const std::string& path) {
    HttpRequest result;
    result.method = method;
    result.path = path;
    result.request_id = "test-1";
    return result;
  }

  /// A raw scan of `count` points (x y z i) in front of the sensor.
  static std::string raw_scan(std::size_t count) {
    std::vector<float> floats;
    for (std::size_t i = 0; i < count; ++i) {
      floats.insert(floats.end(), {1.0F + 0.01F * static_cast<float>(i), 2.0F, 3.0F, 0.5F});
    }
    std::string bytes(floats.size() * sizeof(float), '\0');
    std::memcpy(bytes.data(), floats.data(), bytes.size());
    return bytes;
  }

  /// A pose request that is right in every way.
  static HttpRequest good_request() {
    HttpRequest result = request("POST", "/v1/maps/town/localize");
    result.headers["content-type"] = "application/octet-stream";
    result.query = {{"prior_t", "1,2,3"}, {"prior_q", "0,0,0,1"}};
    result.body = raw_scan(60);
    return result;
  }

  static nlohmann::json body(const HttpResponse& response) {
    return nlohmann::json::parse(response.body);
  }

  TownStore store_;
  ServerOptions options_{.store = {}, .workers = 1, .queue = 0};
  /// Program that does the jobs; none by default.
  std::filesystem::path mapper_;
  std::shared_ptr<StubAligner> aligner_ = std::make_shared<StubAligner>();
  std::unique_ptr<Service> service_;
};

}  // namespace stillmap::server

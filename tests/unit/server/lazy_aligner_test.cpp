#include "catalog/lazy_aligner.hpp"

#include "errors/api_error.hpp"
#include "service_fixture.hpp"

#include <gmock/gmock.h>

#include <atomic>
#include <chrono>
#include <latch>
#include <stdexcept>
#include <thread>

namespace stillmap::server {
namespace lazy_aligner_test {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::Pair;

/// Stands a hundred metres up.
std::unique_ptr<const localization::Aligner> high_aligner() {
  auto aligner = std::make_unique<StubAligner>();
  aligner->answer = [](const localization::Prior& prior) {
    localization::AlignmentResult result;
    result.status = localization::PoseStatus::kOk;
    result.T_map_lidar = prior.T_map_lidar;
    result.T_map_lidar.translation().z() = 100.0;
    result.covariance.setIdentity();
    return result;
  };
  return aligner;
}

/// A service with one worker, whose maps have a default method and another that is made late.
class LazyAlignerTest : public ServiceTest {
 protected:
  void start_with(const LazyAligner::Maker& make) {
    start([this, make](const maps::MapPackage&, const localization::LocalizationOptions&) {
      return Aligners{
          {"default", aligner_},
          {"other", std::make_shared<const LazyAligner>("method 'other'", make, worker_)}};
    });
    wait_until_loaded();
  }
  static HttpRequest other_request() {
    HttpRequest request = good_request();
    request.query.emplace_back("method", "other");
    return request;
  }
  [[nodiscard]] HttpResponse ask_until_made() const {
    HttpResponse response = service_->handle(other_request());
    while (response.status == 503 && body(response)["code"] == "MapLoading") {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      response = service_->handle(other_request());
    }
    return response;
  }

  DerivedWorker worker_;
};

TEST_F(LazyAlignerTest, IsMadeOnceAndKeepsNobodyWaitingMeanwhile) {
  std::latch release(1);
  std::atomic<int> made = 0;
  start_with([&] {
    release.wait();
    ++made;
    return high_aligner();
  });
  for (int i = 0; i < 3; ++i) {
    const HttpResponse early = service_->handle(other_request());
    EXPECT_EQ(early.status, 503);
    EXPECT_EQ(body(early)["code"], "MapLoading");
    EXPECT_THAT(body(early)["detail"].get<std::string>(), HasSubstr("'other'"));
    EXPECT_THAT(early.headers, Contains(Pair("Retry-After", "1")));
    // The only worker is free for others.
    EXPECT_EQ(service_->handle(good_request()).status, 200);
  }
  EXPECT_EQ(made, 0);
  release.count_down();
  const HttpResponse pose = ask_until_made();
  ASSERT_EQ(pose.status, 200) << pose.body;
  EXPECT_EQ(body(pose)["pose"]["position"][2], 100.0);
  EXPECT_EQ(service_->handle(other_request()).status, 200);
  EXPECT_EQ(made, 1);
}

TEST_F(LazyAlignerTest, ThatCannotBeMadeIsRefusedAndNamesNoPlaceOfTheMachine) {
  start_with([&]() -> std::unique_ptr<const localization::Aligner> {
    throw std::runtime_error((store_.folder().path() / "packages/x: too few points").string());
  });
  const HttpResponse response = ask_until_made();
  EXPECT_EQ(response.status, 503);
  EXPECT_EQ(body(response)["code"], "MapUnusable");
  EXPECT_THAT(body(response)["detail"].get<std::string>(),
              Not(HasSubstr(store_.folder().path().string())));
  EXPECT_THAT(response.headers, Contains(Pair("Retry-After", "60")));
  EXPECT_EQ(service_->handle(good_request()).status, 200);
}

TEST(LazyAligner, MayGoWhileItIsBeingMade) {
  DerivedWorker worker;
  std::latch begun(1);
  std::latch release(1);
  {
    const LazyAligner aligner(
        "method 'other'",
        [&] {
          begun.count_down();
          release.wait();
          return high_aligner();
        },
        worker);
    EXPECT_THROW((void)aligner.align({}, {}), ApiError);
    begun.wait();
  }
  release.count_down();
}

/// A floor of 10 m.
std::shared_ptr<const maps::MapPackage> floor_map(const std::filesystem::path& folder) {
  std::vector<maps::MapPoint> points;
  for (int i = 0; i < 10'000; ++i) {
    maps::MapPoint point{};
    point.x = 0.1F * static_cast<float>(i % 100);
    point.y = 0.1F * static_cast<float>(i / 100);
    point.observations = 3;
    points.push_back(point);
  }
  maps::MapPackageWriter writer(folder);
  writer.add_tile({.level = 0, .x = 0, .y = 0}, points);
  writer.write_trajectory(
      maps::Trajectory(std::vector<maps::StampedPose>{{.stamp_ns = 1'000'000'000}}));
  maps::MapManifest manifest;
  manifest.frame_id = "map";
  manifest.voxel_size_m = 0.1;
  writer.publish(manifest, "{}");
  return maps::MapPackage::open(folder);
}

TEST(Aligners, ReferenceMethodsOfAMapAreMadeWhenTheyAreAskedFor) {
  const test::TemporaryFolder folder;
  const auto map = floor_map(folder.path() / "floor");
  const Aligners aligners = build_aligners(*map);
  ASSERT_EQ(aligners.size(), localization::aligner_names().size());
  maps::PointCloud scan;
  for (int i = 0; i < 100; ++i)
    scan.positions.emplace_back(0.5F * static_cast<float>(i % 10),
                                0.5F * static_cast<float>(i / 10), 0.0F);
  const auto align_with = [&](std::size_t i) {
    return aligners[i].second->align(scan, localization::Prior{});
  };
  EXPECT_NO_THROW((void)align_with(0));
  for (std::size_t i = 1; i < aligners.size(); ++i) {
    for (bool is_made = false; !is_made;) {
      try {
        (void)align_with(i);
        is_made = true;
      } catch (const ApiError& error) {
        ASSERT_EQ(error.code(), ErrorCode::kMapLoading);
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    }
  }
}

}  // namespace lazy_aligner_test
}  // namespace stillmap::server

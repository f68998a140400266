#include "loops/keyframe_store.hpp"

#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <atomic>
#include <cstddef>
#include <filesystem>
#include <limits>
#include <stdexcept>
#include <thread>
#include <vector>

#include "support/synthetic_world.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::mapping {
namespace keyframe_store_test {

using test::TemporaryFolder;
using Points = std::vector<Eigen::Vector3f>;

Points view_from(double x) {
  const test::SyntheticWorld world = test::street(1, 40.0);
  return world.scan(test::pose_at(x, 0.0), {.rings = 8, .columns = 90}).positions;
}

TEST(KeyframeStore, GivesPointsBackToHalfAStep) {
  const TemporaryFolder folder;
  KeyframeStore store(folder.path());
  const Points points = {{1.2345F, -77.777F, 0.001F}, {149.9F, 3.3F, -2.2F}, {-5.0F, 8.0F, 1.5F}};
  store.append({});
  store.append(points);
  ASSERT_EQ(store.size(), 2U);
  EXPECT_TRUE(store.read(0).empty());
  const Points read = store.read(1);
  ASSERT_EQ(read.size(), points.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    EXPECT_LT((read[i] - points[i]).cwiseAbs().maxCoeff(), 0.00251F) << i;
  EXPECT_THROW(static_cast<void>(store.read(2)), std::out_of_range);
}

TEST(KeyframeStore, KeepsTheFirstPointOfACell) {
  const TemporaryFolder folder;
  KeyframeStore store(folder.path());
  store.append({{0.1F, 0.1F, 0.1F}, {0.2F, 0.1F, 0.1F}, {-0.1F, 0.1F, 0.1F}, {0.3F, 0.1F, 0.1F}});
  const Points read = store.read(0);
  ASSERT_EQ(read.size(), 3U);
  EXPECT_EQ(store.points_of(0), 3U);
  EXPECT_NEAR(read[0].x(), 0.1F, 1e-3F);
  EXPECT_NEAR(read[1].x(), -0.1F, 1e-3F);
  EXPECT_NEAR(read[2].x(), 0.3F, 1e-3F);
}

TEST(KeyframeStore, LeavesOutWhatIsFarOrNotFinite) {
  const TemporaryFolder folder;
  KeyframeStore store(folder.path());
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  store.append({{150.1F, 0.0F, 0.0F}, {0.0F, nan, 0.0F}, {0.0F, 0.0F, -infinity}, {1, 2, 3}});
  ASSERT_EQ(store.read(0).size(), 1U);
  EXPECT_LT((store.read(0)[0] - Eigen::Vector3f(1, 2, 3)).norm(), 1e-5F);
}

TEST(KeyframeStore, IsReadFromSeveralThreads) {
  const TemporaryFolder folder;
  KeyframeStore store(folder.path());
  for (int i = 0; i < 30; ++i) store.append(view_from(i));
  std::vector<Points> expected;
  for (std::size_t i = 0; i < 30; ++i) expected.push_back(store.read(i));
  std::atomic<int> wrong = 0;
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      for (std::size_t n = 0; n < 100; ++n) {
        const std::size_t i = (17 * n + 7 * t) % expected.size();
        if (store.read(i) != expected[i]) ++wrong;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
}

TEST(KeyframeStore, TakesItsFileWithIt) {
  const TemporaryFolder folder;
  std::filesystem::path file;
  {
    KeyframeStore store(folder.path());
    store.append(view_from(1.0));
    file = store.file();
    EXPECT_TRUE(std::filesystem::exists(file));
  }
  EXPECT_FALSE(std::filesystem::exists(file));
}

TEST(KeyframeStore, NamesAFileThatCannotBeMadeOrEndsTooEarly) {
  const TemporaryFolder folder;
  EXPECT_THROW(KeyframeStore(folder.path() / "missing"), maps::StorageError);
  KeyframeStore store(folder.path());
  store.append(view_from(1.0));
  std::filesystem::resize_file(store.file(), 10);
  EXPECT_THROW(static_cast<void>(store.read(0)), maps::StorageError);
}

}  // namespace keyframe_store_test
}  // namespace stillmap::mapping

#include "views/range_view_store.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <stillmap/maps/error.hpp>

#include <atomic>
#include <csignal>
#include <filesystem>
#include <stdexcept>
#include <thread>
#include <vector>

#include "support/synthetic_world.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace range_view_store_test {

using maps::StorageError;
using test::TemporaryFolder;
using test::ThrowsSaying;

RangeView view_from(double x) {
  const test::SyntheticWorld world = test::street(1, 40.0);
  return {world.scan(test::pose_at(x, 0.0), {.rings = 8, .columns = 90}).positions, {}};
}

TEST(RangeViewStore, GivesBackWhatWasPutIn) {
  const TemporaryFolder folder;
  RangeViewStore store(folder.path());
  for (int i = 0; i < 40; ++i) store.append(view_from(i));
  ASSERT_EQ(store.size(), 40U);
  for (const std::size_t i : {39U, 0U, 17U, 0U, 38U})
    EXPECT_EQ(*store.read(i), view_from(static_cast<double>(i))) << i;
  EXPECT_THROW(static_cast<void>(store.read(40)), std::out_of_range);
}

TEST(RangeViewStore, IsReadFromSeveralThreads) {
  const TemporaryFolder folder;
  RangeViewStore store(folder.path());
  std::vector<RangeView> views;
  for (int i = 0; i < 50; ++i) views.push_back(view_from(0.7 * i));
  for (const RangeView& view : views) store.append(view);
  std::atomic<int> wrong = 0;
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      for (std::size_t n = 0; n < 200; ++n) {
        const std::size_t i = (17 * n + 7 * t) % views.size();
        if (!(*store.read(i) == views[i])) ++wrong;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
}

TEST(RangeViewStore, LeavesNothingBehind) {
  const TemporaryFolder folder;
  {
    RangeViewStore store(folder.path());
    store.append(view_from(0.0));
    EXPECT_FALSE(std::filesystem::is_empty(folder.path()));
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(RangeViewStore, NamesAFolderThatIsNotThere) {
  const TemporaryFolder folder;
  const std::filesystem::path missing = folder.path() / "missing";
  EXPECT_THAT([&] { RangeViewStore store(missing); },
              ThrowsSaying<StorageError>({missing.string(), "No such file"}));
}

TEST(RangeViewStore, NamesAFileThatWasCutShort) {
  const TemporaryFolder folder;
  RangeViewStore store(folder.path());
  for (int i = 0; i < 3; ++i) store.append(view_from(i));
  std::filesystem::resize_file(store.file(), std::filesystem::file_size(store.file()) - 10);
  EXPECT_EQ(*store.read(1), view_from(1.0));
  EXPECT_THAT([&] { static_cast<void>(store.read(2)); },
              ThrowsSaying<StorageError>({store.file().string(), "ends at byte"}));
}

TEST(RangeViewStore, NamesAFileThatHoldsSomethingElse) {
  const TemporaryFolder folder;
  RangeViewStore store(folder.path());
  store.append(view_from(0.0));
  const auto bytes = std::filesystem::file_size(store.file());
  std::filesystem::resize_file(store.file(), 0);
  std::filesystem::resize_file(store.file(), bytes);
  EXPECT_THAT([&] { static_cast<void>(store.read(0)); },
              ThrowsSaying<StorageError>({store.file().string(), "at byte 0"}));
}

TEST(RangeViewStore, NamesAFullDiskAndKeepsWhatItHas) {
  const TemporaryFolder folder;
  RangeViewStore store(folder.path());
  store.append(view_from(0.0));
  // A file that may grow no further fails as one on a full disk does.
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  rlimit limit = before;
  limit.rlim_cur = std::filesystem::file_size(store.file()) + 100;
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
  EXPECT_THAT([&] { store.append(view_from(1.0)); },
              ThrowsSaying<StorageError>({store.file().string(), "too large"}));
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  EXPECT_EQ(store.size(), 1U);
  store.append(view_from(2.0));
  EXPECT_EQ(*store.read(0), view_from(0.0));
  EXPECT_EQ(*store.read(1), view_from(2.0));
}

}  // namespace range_view_store_test
}  // namespace stillmap::mapping

#include <stillmap/maps/scratch_vector.hpp>

#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <utility>
#include <vector>

#include "support/temporary_folder.hpp"

namespace stillmap::maps {
namespace scratch_vector_test {

struct Item {
  std::uint64_t number = 0;
  char rest[1000] = {};
};

TEST(ScratchVector, KeepsItsItemsInPlaceWhereverTheyRest) {
  const test::TemporaryFolder folder;
  for (const std::filesystem::path& where : {folder.path(), std::filesystem::path()}) {
    ScratchVector<Item> items(where);
    const Item* first = &items.push_back({.number = 7});
    for (std::uint64_t i = 1; i < 20'000; ++i) items.push_back({.number = 7 * (i + 1)});
    items.rest();
    EXPECT_EQ(first, &items[0]);
    items[5].number = 1;
    items.rest();
    EXPECT_EQ(items[5].number, 1U);
    for (std::uint64_t i = 6; i < items.size(); ++i) ASSERT_EQ(items[i].number, 7 * (i + 1));
    items.clear();
    EXPECT_TRUE(items.empty());
    EXPECT_EQ(items.push_back({.number = 3}).number, 3U);
    EXPECT_EQ(first, &items[0]);
  }
}

std::size_t resident_bytes() {
  std::ifstream statm("/proc/self/statm");
  std::size_t size = 0, resident = 0;
  statm >> size >> resident;
  return resident * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

TEST(ScratchVector, NeedsNoMemoryForWhatRests) {
  const test::TemporaryFolder folder;
  ScratchVector<Item> items(folder.path());
  const std::size_t before = resident_bytes();
  for (std::uint64_t i = 0; i < 200'000; ++i) {
    items.push_back({.number = i});
    if (rests_after(i)) items.rest();
  }
  // 200 MB, of which 4,096 items were in use.
  EXPECT_LT(resident_bytes(), before + (std::size_t{40} << 20));
  EXPECT_EQ(items[123'456].number, 123'456U);
}

TEST(ScratchVector, LeavesNoFileBehindAndNamesAFolderThatIsNotThere) {
  const test::TemporaryFolder folder;
  {
    ScratchVector<int> items(folder.path());
    items.push_back(1);
    // Nor would one be left if the process were killed here.
    EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
    const ScratchVector<int> moved(std::move(items));
    EXPECT_EQ(moved[0], 1);
    EXPECT_TRUE(items.empty());
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  ScratchVector<int> nowhere(folder.path() / "missing");
  EXPECT_THROW(nowhere.push_back(1), StorageError);
}

}  // namespace scratch_vector_test
}  // namespace stillmap::maps

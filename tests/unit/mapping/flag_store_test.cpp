#include "core/flag_store.hpp"

#include <gtest/gtest.h>

#include <stdexcept>
#include <vector>

#include "support/temporary_folder.hpp"

namespace stillmap::mapping {
namespace flag_store_test {

TEST(FlagStore, GivesTheFlagsOfEachScanBack) {
  const test::TemporaryFolder folder;
  FlagStore store(folder.path());
  std::vector<std::vector<bool>> scans{{true, false, true}, {}, std::vector<bool>(1001, true)};
  scans[2][1000] = false;
  scans[2][8] = false;
  for (const auto& flags : scans) store.append(flags);
  for (const std::size_t scan : {2U, 0U, 1U}) EXPECT_EQ(store.read(scan), scans[scan]) << scan;
  EXPECT_THROW(static_cast<void>(store.read(3)), std::out_of_range);
}

}  // namespace flag_store_test
}  // namespace stillmap::mapping

#include "reference/cleaners.hpp"

#include "unit/mapping/scans_in_memory.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace stillmap::mapping {
namespace reference_cleaners_test {

using ::testing::IsSupersetOf;

TEST(ReferenceCleaners, AreMadeByName) {
  const std::vector<std::string> names = reference_cleaner_names();
  EXPECT_EQ(names.front(), "none");
  EXPECT_THAT(names, IsSupersetOf({"none", "dufomap", "octomap"}));
  for (const std::string& name : names) EXPECT_NE(make_reference_cleaner(name), nullptr) << name;
  EXPECT_EQ(make_reference_cleaner("dufo"), nullptr);
  EXPECT_EQ(make_reference_cleaner(""), nullptr);
}

TEST(ReferenceCleaners, NoneKeepsAll) {
  CleaningPoints points;
  test::ScansInMemory::add_point(points, {1.0F, 2.0F, 3.0F});
  const CancelFlag never{false};
  EXPECT_EQ(make_reference_cleaner("none")->moved(points, test::ScansInMemory(), {}, never),
            std::vector<std::uint8_t>(1, 0));
}

}  // namespace reference_cleaners_test
}  // namespace stillmap::mapping

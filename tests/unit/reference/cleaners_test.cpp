#include <stillmap/mapping/reference.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace stillmap::mapping {
namespace cleaners_test {

using ::testing::IsSupersetOf;

TEST(ReferenceCleaners, AreMadeByName) {
  const std::vector<std::string> names = reference_cleaner_names();
  EXPECT_THAT(names, IsSupersetOf({"dufomap", "octomap"}));
  for (const std::string& name : names) EXPECT_NE(make_reference_cleaner(name), nullptr) << name;
  EXPECT_EQ(make_reference_cleaner("dufo"), nullptr);
  EXPECT_EQ(make_reference_cleaner(""), nullptr);
}

}  // namespace cleaners_test
}  // namespace stillmap::mapping

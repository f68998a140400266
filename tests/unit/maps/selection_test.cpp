#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/drive.hpp>

#include <stdexcept>

namespace stillmap::maps {
namespace selection_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::ThrowsMessage;

std::vector<std::size_t> select(const char* text, std::size_t size) {
  return Selection::parse(text).indices(size);
}

TEST(Selection, WorksAsInPython) {
  EXPECT_THAT(select("::2", 5), ElementsAre(0, 2, 4));
  EXPECT_THAT(select("1::2", 5), ElementsAre(1, 3));
  EXPECT_THAT(select(":", 3), ElementsAre(0, 1, 2));
  EXPECT_THAT(select("::", 3), ElementsAre(0, 1, 2));
  EXPECT_THAT(select("1:3", 5), ElementsAre(1, 2));
  EXPECT_THAT(select("2:10:3", 6), ElementsAre(2, 5));
}

TEST(Selection, IsEmptyBeyondTheDriveOrTurnedAround) {
  EXPECT_THAT(select("7:", 5), IsEmpty());
  EXPECT_THAT(select("3:1", 5), IsEmpty());
  EXPECT_THAT(select(":", 0), IsEmpty());
}

TEST(Selection, DoesNotWrapWithTheLargestStep) {
  EXPECT_THAT(select("1::18446744073709551615", 5), ElementsAre(1));
}

TEST(Selection, RefusesWhatIsNoSelectionByName) {
  for (const char* text :
       {"", "5", "a:b", "1:2:3:4", "::0", "-1:", "1 :", "::1.5", "99999999999999999999:"}) {
    EXPECT_THAT([&] { (void)Selection::parse(text); },
                ThrowsMessage<std::invalid_argument>(HasSubstr("'" + std::string(text) + "'")));
  }
}

}  // namespace selection_test
}  // namespace stillmap::maps

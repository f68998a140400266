// The page that describes the interface says everything that the server can say.
#include <gmock/gmock.h>

#include <fstream>
#include <iterator>
#include <string>

#include "error_codes.hpp"

namespace stillmap::server {
namespace {

TEST(ApiPage, NamesEveryErrorCodeBesideItsStatus) {
  std::ifstream file(STILLMAP_API_PAGE);
  const std::string page{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  ASSERT_FALSE(page.empty()) << STILLMAP_API_PAGE;
  for (const ErrorInfo& error : all_errors()) {
    const std::string row = "\n\\| " + std::to_string(error.http_status) + " \\| [^\n]*`" +
                            std::string(error.text) + "`";
    EXPECT_THAT(page, ::testing::ContainsRegex(row));
  }
}

}  // namespace
}  // namespace stillmap::server

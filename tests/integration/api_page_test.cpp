// The page that describes the interface says everything that the server can say.
#include <gmock/gmock.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <string>

#include "errors/error_codes.hpp"
#include "metrics/metrics.hpp"

namespace stillmap::server {
namespace {

std::string api_page() {
  std::ifstream file(STILLMAP_API_PAGE);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

TEST(ApiPage, NamesEveryErrorCodeBesideItsStatus) {
  const std::string page = api_page();
  ASSERT_FALSE(page.empty()) << STILLMAP_API_PAGE;
  for (const ErrorInfo& error : all_errors()) {
    const std::string row = "\n\\| " + std::to_string(error.http_status) + " \\| [^\n]*`" +
                            std::string(error.text) + "`";
    EXPECT_THAT(page, ::testing::ContainsRegex(row));
  }
}

TEST(ApiPage, HasTheMetricsAsTheyAre) {
  const std::string page = api_page();
  std::size_t rows = 0;
  for (const MetricInfo& info : all_metrics()) {
    std::string labels;
    for (const char c : info.labels) labels += c == ',' ? std::string("`, `") : std::string(1, c);
    if (!labels.empty()) labels = "`" + labels + "`";
    EXPECT_THAT(page, ::testing::HasSubstr("\n| `" + std::string(info.name) + "` | " +
                                           std::string(info.type) + " | " + labels + " | " +
                                           std::string(info.help) + " |\n"));
  }
  for (std::size_t at = page.find("\n| `stillmap_"); at != std::string::npos;
       at = page.find("\n| `stillmap_", at + 1)) {
    ++rows;
  }
  const auto ours = [](const MetricInfo& info) { return info.name.starts_with("stillmap_"); };
  EXPECT_EQ(rows, std::count_if(all_metrics().begin(), all_metrics().end(), ours));
}

}  // namespace
}  // namespace stillmap::server

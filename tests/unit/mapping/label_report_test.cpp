#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/label_evaluation.hpp>

#include <limits>
#include <string>

namespace stillmap::mapping {
namespace label_report_test {

using ::testing::HasSubstr;
using ::testing::Not;

LabelEvaluation evaluation() {
  LabelEvaluation result;
  result.scans = 3;
  result.drive_in_map = true;
  result.true_ground = TrueGround::kSurface;
  MapFigures figures;
  for (MapScores& scores : figures.scores) {
    scores.static_kept = {990, 1000};
    scores.SA = 0.99;
    scores.AA = std::numeric_limits<double>::quiet_NaN();
  }
  figures.parked_removed = {1234567, 2000000};
  figures.ground_under.filled = {95, 100};
  figures.losses = {{50, "building", {5, 1000}, {}, 0.005}};
  result.unthinned = figures;
  result.thinned = figures;
  result.heights.emplace();
  result.heights->one_surface = {4, 0.02, 0.05, std::vector<double>(101, 0.02)};
  result.ground = GroundScores{90, 10, 10};
  return result;
}

LabelReportHeading heading(const std::string& map, const std::string& command = "") {
  return {map, "D", TruthClasses::kMovable, command};
}

TEST(LabelReport, ShowsRatesWithTheirCounts) {
  const std::string page = to_html(evaluation(), heading("M"));
  EXPECT_THAT(page, HasSubstr("99.00 %<br><small>990 of 1\u2009000</small>"));
  EXPECT_THAT(page, HasSubstr("61.73 %"));
  EXPECT_THAT(page, HasSubstr("<td>building</td>"));
  EXPECT_THAT(page, HasSubstr("90.00 %"));
  EXPECT_THAT(page, Not(HasSubstr("nan")));
}

TEST(LabelReport, NeedsNoOtherFileAndNoScript) {
  LabelEvaluation result = evaluation();
  result.pictures = MapPictures{"abcd", "\xFF\xFE"};
  const std::string page = to_html(result, {});
  EXPECT_THAT(page, HasSubstr("data:image/png;base64,YWJjZA==\""));
  EXPECT_THAT(page, HasSubstr("data:image/png;base64,//4=\""));
  EXPECT_THAT(page, Not(HasSubstr("<script")));
  EXPECT_THAT(page, Not(HasSubstr("http")));
}

TEST(LabelReport, EscapesNames) {
  const std::string page = to_html(evaluation(), heading("<b>&\"", "a<b"));
  EXPECT_THAT(page, HasSubstr("&lt;b&gt;&amp;&quot;"));
  EXPECT_THAT(page, HasSubstr("a&lt;b"));
}

TEST(LabelReport, SaysWhatIsNotKnown) {
  LabelEvaluation result = evaluation();
  result.unthinned.reset();
  result.heights.reset();
  result.ground.reset();
  result.drive_in_map = false;
  result.true_ground = TrueGround::kNone;
  const std::string page = to_html(result, {});
  EXPECT_THAT(page, HasSubstr("was not made of this drive"));
  EXPECT_THAT(page, HasSubstr("No true ground"));
}

}  // namespace label_report_test
}  // namespace stillmap::mapping

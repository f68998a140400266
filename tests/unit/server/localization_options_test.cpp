#include <gmock/gmock.h>
#include <stillmap/maps/error.hpp>

#include <fstream>
#include <string>

#include "json/localization_options_json.hpp"
#include "service_fixture.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace localization_options_test {

using localization::LocalizationOptions;
using test::ThrowsSaying;
using ::testing::HasSubstr;

class LocalizationOptionsFile : public ::testing::Test {
 protected:
  [[nodiscard]] std::filesystem::path written(const std::string& text) const {
    const std::filesystem::path file = folder_.path() / "town.json";
    std::ofstream(file) << text;
    return file;
  }
  void expect_refused(const std::string& text, const std::vector<std::string>& saying) const {
    const std::filesystem::path file = written(text);
    EXPECT_THAT([&] { (void)read_localization_options(file); },
                ThrowsSaying<maps::InputError>(saying))
        << text;
  }

  test::TemporaryFolder folder_;
};

TEST_F(LocalizationOptionsFile, ChangesWhatItNamesOfItsPreset) {
  const LocalizationOptions options = read_localization_options(written(
      R"({"preset": "indoor", "aligner": {"max_places": 7}, "verdict": {"ok_support": 0.8}})"));
  EXPECT_EQ(options.aligner.max_places, 7);
  EXPECT_EQ(options.verdict.ok_support, 0.8);
  EXPECT_EQ(options.aligner.search_radius_m,
            localization::preset("indoor").aligner.search_radius_m);
}

TEST_F(LocalizationOptionsFile, OfAllOptionsReadsBackTheSame) {
  const LocalizationOptions handheld = localization::preset("handheld");
  const LocalizationOptions back =
      read_localization_options(written(localization_options_json(handheld)));
  for (const localization::OptionInfo& each : localization::all_options())
    EXPECT_EQ(each.get(back), each.get(handheld)) << each.key;
}

TEST_F(LocalizationOptionsFile, FaultsNameTheKeyAndWhatIsExpected) {
  expect_refused(R"({"preset": "boat"})", {"town.json", "preset", "boat", "vehicle, indoor"});
  expect_refused(R"({"aligner": {"search_radius": 4}})", {"search_radius", "search_radius_m"});
  expect_refused(R"({"aligner": {"search_radius_m": 400}})", {"search_radius_m", "400", "30"});
  expect_refused(R"({"aligner": {"max_places": 2.5}})", {"max_places", "2.5"});
  expect_refused(R"({"aligner": {"max_places": 2, "max_places": 3}})", {"max_places"});
  expect_refused(R"({"localizer": {}})", {"localizer"});
  expect_refused(R"({"tracker": 3})", {"tracker", "an object"});
  expect_refused("{", {"town.json"});
}

TEST_F(LocalizationOptionsFile, OfAMapIsOptional) {
  (void)written(R"({"tracker": {"max_coast_s": 1.5}})");
  EXPECT_EQ(localization_options_of(folder_.path(), "town").tracker.max_coast_s, 1.5);
  const double usual = LocalizationOptions{}.tracker.max_coast_s;
  EXPECT_EQ(localization_options_of(folder_.path(), "garage").tracker.max_coast_s, usual);
  EXPECT_EQ(localization_options_of("", "town").tracker.max_coast_s, usual);
}

class OptionsOfAMap : public ServiceTest {
 protected:
  void start_with(const std::string& text) {
    std::ofstream(options_folder_.path() / "town.json") << text;
    options_.localization_options_dir = options_folder_.path().string();
    start([this](const maps::MapPackage&, const LocalizationOptions& options) {
      got_ = options;
      return Aligners{{"default", aligner_}};
    });
  }

  test::TemporaryFolder options_folder_;
  LocalizationOptions got_;
};

TEST_F(OptionsOfAMap, ReachItsAligner) {
  start_with(R"({"verdict": {"max_ok_deviation_m": 0.05}})");
  wait_until_loaded();
  EXPECT_EQ(got_.verdict.max_ok_deviation_m, 0.05);
}

TEST_F(OptionsOfAMap, ThatAreBrokenAreSaidByReadyz) {
  start_with(R"({"verdict": {"max_ok_deviation_m": 50}})");
  std::string answer;
  for (int i = 0; i < 5000 && answer.find("max_ok_deviation_m") == std::string::npos; ++i) {
    answer = get("/readyz").body;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_THAT(answer, HasSubstr("max_ok_deviation_m"));
}

}  // namespace localization_options_test
}  // namespace stillmap::server

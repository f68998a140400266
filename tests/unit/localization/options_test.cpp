#include <stillmap/localization/options.hpp>

#include <gmock/gmock.h>
#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/reason.hpp>

#include <cmath>
#include <limits>
#include <set>
#include <stdexcept>
#include <string>

#include "support/throws.hpp"

namespace stillmap::localization {
namespace options_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(LocalizationOptions, EveryPresetIsUsable) {
  for (const std::string_view name : preset_names())
    EXPECT_THAT(preset(name).violations(), IsEmpty()) << name;
}

TEST(LocalizationOptions, DefaultsAreThePresetOfVehicles) {
  const LocalizationOptions defaults;
  for (const OptionInfo& each : all_options())
    EXPECT_EQ(each.get(defaults), each.get(preset("vehicle"))) << each.key;
}

TEST(LocalizationOptions, EveryPresetDiffersFromTheOthers) {
  std::set<std::string> seen;
  for (const std::string_view name : preset_names()) {
    std::string values;
    for (const OptionInfo& each : all_options())
      values += std::to_string(each.get(preset(name))) + " ";
    EXPECT_TRUE(seen.insert(values).second) << name;
  }
}

TEST(LocalizationOptions, AnUnknownPresetIsNamedWithTheChoices) {
  EXPECT_THAT([] { (void)preset("boat"); },
              test::ThrowsSaying<std::invalid_argument>({"preset: found 'boat'", "indoor"}));
}

TEST(LocalizationOptions, EveryOptionHasItsOwnFieldAndBothBounds) {
  for (const OptionInfo& each : all_options()) {
    LocalizationOptions options;
    each.set(options, each.least);
    EXPECT_EQ(each.get(options), each.least) << each.key;
    EXPECT_THAT(options.violations(), IsEmpty()) << each.key;
    each.set(options, each.most);
    EXPECT_THAT(options.violations(), IsEmpty()) << each.key;
    each.set(options, each.most + 1.0);
    EXPECT_THAT(options.violations(), ElementsAre(HasSubstr(std::string(each.key)))) << each.key;
    for (const OptionInfo& other : all_options()) {
      if (other.key == each.key) continue;
      EXPECT_EQ(other.get(options), other.get(LocalizationOptions{})) << each.key;
    }
  }
}

TEST(LocalizationOptions, NumbersThatAreNoneAreRefused) {
  for (const OptionInfo& each : all_options()) {
    if (each.whole) continue;
    LocalizationOptions options;
    each.set(options, std::numeric_limits<double>::quiet_NaN());
    EXPECT_THAT(options.violations(), ElementsAre(HasSubstr(std::string(each.key))));
  }
}

TEST(LocalizationOptions, OfEachPartAreCheckedApart) {
  AlignerOptions aligner;
  aligner.search_radius_m = 0.0;
  EXPECT_THAT(aligner.violations(),
              ElementsAre("aligner.search_radius_m: found 0, expected 1 to 30"));
  VerdictOptions verdict;
  verdict.ok_support = 1.5;
  EXPECT_THAT(verdict.violations(), ElementsAre(HasSubstr("verdict.ok_support")));
}

TEST(Reasons, EachHasAWordOfItsOwn) {
  std::set<std::string_view> words;
  for (const Reason reason : all_reasons()) EXPECT_TRUE(words.insert(name_of(reason)).second);
  EXPECT_EQ(words.size(), static_cast<std::size_t>(Reason::kClockSetBack) + 1);
  EXPECT_THAT(names_of({Reason::kTooOld, Reason::kAmbiguous}), ElementsAre("too_old", "ambiguous"));
}

}  // namespace options_test
}  // namespace stillmap::localization

// A request's JSON is read in time that grows as its bytes do, whatever is repeated in it.
#include "json/request_json.hpp"

#include "errors/api_error.hpp"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <ctime>
#include <string>
#include <vector>

namespace stillmap::server {
namespace {

const JsonBounds kLoose{.max_bytes = 64 * 1024 * 1024, .max_values = 100'000'000};

std::string repeated(const std::string& element, std::size_t count) {
  std::string text = "{\"points\":[";
  for (std::size_t i = 0; i < count; ++i) text += (i == 0 ? "" : ",") + element;
  return text + "]}";
}

std::string members(std::size_t count) {
  std::string text = "{";
  for (std::size_t i = 0; i < count; ++i)
    text += (i == 0 ? "\"k" : ",\"k") + std::to_string(i) + "\":{}";
  return text + "}";
}

double cpu_s() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

double reading_s(const std::string& text) {
  const double begin = cpu_s();
  EXPECT_TRUE(parse_request_json(text, kLoose).is_object());
  return cpu_s() - begin;
}

/// Median of five pairs, read in turns: what else the machine does meets both.
double growth_of(const std::string& large, const std::string& small) {
  std::array<double, 5> growths{};
  for (double& growth : growths) growth = reading_s(large) / reading_s(small);
  std::sort(growths.begin(), growths.end());
  return growths[2];
}

std::string refused(const std::string& text, std::size_t max_values = kLoose.max_values) {
  try {
    static_cast<void>(
        parse_request_json(text, {.max_bytes = kLoose.max_bytes, .max_values = max_values}));
  } catch (const ApiError& error) {
    return error.what();
  }
  return "taken";
}

/// Four times the elements take at most six times as long. A busy machine may disturb a
/// measurement, so it is repeated; time that grows with the square fails each of them.
/// @param text  makes the text of so many elements.
template <typename Text>
void expect_linear(const Text& text) {
#ifdef __SANITIZE_ADDRESS__
  GTEST_SKIP() << "the sanitizer's allocator takes most of the time";
#endif
  constexpr std::size_t kCount = 50'000;
  double growth = 0.0;
  for (int i = 0; i < 4; ++i) {
    growth = growth_of(text(4 * kCount), text(kCount));
    if (growth < 6.0) return;
  }
  FAIL() << "four times the elements take " << growth << " times as long";
}

class GrowthOfARequest : public ::testing::TestWithParam<std::string> {};

TEST_P(GrowthOfARequest, IsLinear) {
  expect_linear([this](std::size_t count) { return repeated(GetParam(), count); });
}

INSTANTIATE_TEST_SUITE_P(Elements, GrowthOfARequest,
                         ::testing::Values("{}", "[]", "\"\"", "0", "null", R"({"a":{}})",
                                           R"([[],[],[]])", R"({"a":1,"b":[{}]})",
                                           R"([[[[[[]]]]]])"));

TEST(RequestJson, GrowsWithItsMembersAsWithItsElements) { expect_linear(members); }

TEST(RequestJson, IsWhatTheTextSays) {
  const std::string text =
      R"({"a": [1, -2, 3.5, "x", null, true, {"b": []}, [[]]], "c": 18446744073709551615})";
  EXPECT_EQ(parse_request_json(text, kLoose), nlohmann::json::parse(text));
  EXPECT_EQ(parse_request_json("7", kLoose), 7);
}

TEST(RequestJson, EndsWhereItsBoundsEnd) {
  EXPECT_EQ(refused(R"({"a": [1, 2]})", 4), "taken");
  EXPECT_NE(refused(R"({"a": [1, 2]})", 3).find("at most 3"), std::string::npos);
  EXPECT_EQ(refused("[[[[[[[[1]]]]]]]]"), "taken");
  EXPECT_NE(refused("[[[[[[[[[1]]]]]]]]]").find("at most 8"), std::string::npos);
  EXPECT_NE(refused(std::string(1'000'000, '[')).find("at most 8"), std::string::npos);
}

TEST(RequestJson, RefusesWhatTwoReadersWouldReadDifferently) {
  EXPECT_NE(refused(R"({"map": "a", "map": "b"})").find("twice"), std::string::npos);
  EXPECT_EQ(refused(R"({"map": {"map": 1}, "b": {"map": 1}})"), "taken");
}

TEST(RequestJson, SaysWhereTheTextBreaksOff) {
  EXPECT_NE(refused(R"({"a": [1, )").find("JSON: "), std::string::npos);
  EXPECT_NE(refused("").find("JSON: "), std::string::npos);
  EXPECT_NE(refused("{} {}").find("JSON: "), std::string::npos);
}

JsonWithPoints with_points(const std::string& text, std::size_t depth = 1) {
  return parse_json_with_points(text, {.max_bytes = kLoose.max_bytes, .max_values = 20}, depth, 3);
}

TEST(JsonPoints, AreReadBesideTheJson) {
  const JsonWithPoints read =
      with_points(R"({"a": [1], "points": [[1, -2.5, 3e1], [0, 0, 0.0], [7, 8, 9]], "b": 2})");
  EXPECT_EQ(read.json, nlohmann::json::parse(R"({"a": [1], "points": 0, "b": 2})"));
  ASSERT_EQ(read.lists.size(), 1U);
  EXPECT_FALSE(read.lists[0].error);
  EXPECT_EQ(read.lists[0].positions,
            (std::vector<Eigen::Vector3f>{{1.0F, -2.5F, 30.0F}, {7.0F, 8.0F, 9.0F}}));
}

TEST(JsonPoints, AreNoValuesThatTheBoundCounts) {
  EXPECT_EQ(
      with_points(R"({"points": [[1, 2, 3], [4, 5, 6], [7, 8, 9]]})").lists[0].positions.size(),
      3U);
  EXPECT_THROW(with_points(R"({"other": [[1, 2, 3], [4, 5, 6], [7, 8, 9], [1, 2, 3], [4, 5, 6]]})"),
               ApiError);
}

TEST(JsonPoints, StayWithTheirQuery) {
  const JsonWithPoints read = with_points(
      R"({"queries": [{"points": [[1, 2]]}, {"points": 5}, {"points": [[1, 2, 3]]}], "points": 8})",
      3);
  ASSERT_EQ(read.lists.size(), 3U);
  EXPECT_STREQ(read.lists[0].error->what(), "points[0]: found something else, expected [x, y, z]");
  EXPECT_STREQ(read.lists[1].error->what(), "points: found 5, expected an array");
  EXPECT_FALSE(read.lists[2].error);
  EXPECT_EQ(read.lists[2].positions.size(), 1U);
  EXPECT_EQ(read.json["queries"][2]["points"], 2);
  EXPECT_EQ(read.json["points"], 8);
}

class UnusablePoints : public ::testing::TestWithParam<const char*> {};

TEST_P(UnusablePoints, AreNamedAndTheRestIsRead) {
  const JsonWithPoints read =
      with_points(R"({"points": )" + std::string(GetParam()) + R"(, "behind": {"a": [1]}})");
  ASSERT_EQ(read.lists.size(), 1U);
  ASSERT_TRUE(read.lists[0].error) << GetParam();
  EXPECT_TRUE(read.lists[0].positions.empty());
  EXPECT_EQ(read.json["behind"], nlohmann::json::parse(R"({"a": [1]})"));
}

INSTANTIATE_TEST_SUITE_P(Lists, UnusablePoints,
                         ::testing::Values("{}", R"({"points": [[1, 2, 3]]})", "null", R"("abc")",
                                           "[1, 2, 3]", "[[1, 2]]", "[[1, 2, 3, 4]]",
                                           "[[1, 2, null]]",
                                           R"([[1, 2, 3], {"x": 1, "y": 2, "z": 3}])",
                                           "[[[1, 2, 3]]]", "[[1, 2, [3]]]", "[[1, 2, 3], 7]",
                                           "[[1, 2, 3], [1, 2, 3], [1, 2, 3], [1, 2, 3]]",
                                           R"([[1, 2, 3, {"points": [[1]]}], [1, 2, 3]])"));

TEST(JsonPoints, AreNestedNoDeeperThanOtherValues) {
  EXPECT_THROW(with_points(R"({"points": )" + std::string(1'000'000, '[')), ApiError);
}

TEST(RequestJson, IsGivenUpWhenNobodyWaitsForIt) {
  const std::string text = repeated("{}", 100'000);
  const std::string points = repeated("[1,2,3]", 100'000);
  int calls = 0;
  JsonBounds bounds = kLoose;
  bounds.require_wanted = [&] {
    if (++calls == 3) throw ApiError(ErrorCode::kDeadlineExceeded, "late");
  };
  EXPECT_THROW(static_cast<void>(parse_request_json(text, bounds)), ApiError);
  EXPECT_EQ(calls, 3);
  calls = 0;
  EXPECT_THROW(static_cast<void>(parse_json_with_points(points, bounds, 1, 1'000'000)), ApiError);
  EXPECT_EQ(calls, 3);
}

}  // namespace
}  // namespace stillmap::server

// A request's JSON is read in time that grows as its bytes do, whatever is repeated in it.
#include "json/request_json.hpp"

#include "errors/api_error.hpp"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <ctime>
#include <limits>
#include <string>

namespace stillmap::server {
namespace {

constexpr std::size_t kMaxBytes = 64 * 1024 * 1024;

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

/// Least of five: what else the machine does only adds.
double reading_s(const std::string& text) {
  double least = 1e9;
  for (int i = 0; i < 5; ++i) {
    const double begin = cpu_s();
    EXPECT_TRUE(parse_request_json(text, kMaxBytes).is_object());
    least = std::min(least, cpu_s() - begin);
  }
  return least;
}

std::string refused(const std::string& text,
                    std::size_t max_values = std::numeric_limits<std::size_t>::max()) {
  try {
    static_cast<void>(parse_request_json(text, kMaxBytes, max_values));
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
    growth = reading_s(text(4 * kCount)) / reading_s(text(kCount));
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
  EXPECT_EQ(parse_request_json(text, kMaxBytes), nlohmann::json::parse(text));
  EXPECT_EQ(parse_request_json("7", kMaxBytes), 7);
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

}  // namespace
}  // namespace stillmap::server

#include "log/trace_context.hpp"

#include <gmock/gmock.h>

#include <set>

namespace stillmap::server {
namespace trace_context_test {

constexpr const char* kGood = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";

TEST(TraceContext, ReadsTheExampleOfTheRecommendation) {
  const auto span = parse_traceparent(kGood);
  ASSERT_TRUE(span);
  EXPECT_EQ(span->trace_id, "4bf92f3577b34da6a3ce929d0e0e4736");
  EXPECT_EQ(span->span_id, "00f067aa0ba902b7");
  EXPECT_EQ(span->flags, 1);
  EXPECT_EQ(traceparent_of(*span), kGood);
}

TEST(TraceContext, VersionsToComeMayAddFieldsAndUnknownFlagsAreDropped) {
  std::string later = kGood;
  later.replace(0, 2, "cc");
  EXPECT_TRUE(parse_traceparent(later));
  EXPECT_TRUE(parse_traceparent(later + "-what-else"));
  EXPECT_FALSE(parse_traceparent(later + "what-else"));
  std::string flags = kGood;
  flags.replace(53, 2, "fe");
  EXPECT_EQ(parse_traceparent(flags)->flags, 0);
}

TEST(TraceContext, RefusesWhatBreaksARule) {
  const std::string good = kGood;
  std::vector<std::string> bad = {"",          "00",       good + "-",   good + " ",
                                  " " + good,  good + "0", good + "-00", good.substr(1),
                                  good + "\n", good + good};
  const auto with = [&](std::size_t at, const std::string& text) {
    std::string changed = good;
    bad.push_back(changed.replace(at, text.size(), text));
  };
  with(0, "ff");
  with(0, "0G");
  with(0, "FF");
  with(2, "_");
  with(35, "0");
  with(52, " ");
  with(3, "4BF9");
  with(3, std::string(32, '0'));
  with(36, std::string(16, '0'));
  with(10, std::string(1, '\0'));
  with(10, "\n");
  with(40, "\xff");
  with(40, "\"");
  with(53, "0x");
  bad.emplace_back(1'000'000, '0');
  for (const std::string& each : bad) EXPECT_FALSE(parse_traceparent(each)) << each.substr(0, 80);
}

TEST(TraceContext, EveryByteOfTheHeaderIsLookedAt) {
  const std::string good = kGood;
  for (std::size_t at = 0; at < good.size(); ++at) {
    for (const char c : {'g', 'A', '\0', '\x80', '.'}) {
      std::string changed = good;
      changed[at] = c;
      EXPECT_FALSE(parse_traceparent(changed)) << at;
    }
  }
}

TEST(TraceContext, ChildrenShareTheTraceAndHaveIdsOfTheirOwn) {
  const Span parent = *parse_traceparent(kGood);
  std::set<std::string> ids = {parent.span_id};
  for (int i = 0; i < 1000; ++i) {
    const Span child = child_of(parent);
    EXPECT_EQ(child.trace_id, parent.trace_id);
    EXPECT_EQ(child.flags, parent.flags);
    EXPECT_TRUE(parse_traceparent(traceparent_of(child)));
    EXPECT_TRUE(ids.insert(child.span_id).second);
  }
}

}  // namespace trace_context_test
}  // namespace stillmap::server

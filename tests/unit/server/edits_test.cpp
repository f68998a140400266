#include <gmock/gmock.h>

#include <fstream>
#include <iterator>

#include "job_fixture.hpp"

namespace stillmap::server {
namespace edits_test {

using nlohmann::json;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Key;

class SavedEditsTest : public JobTest {
 protected:
  static constexpr const char* kEdits = "/v1/maps/town/edits";

  static json document(int count) {
    json edits = json::array();
    for (int i = 0; i < count; ++i)
      edits.push_back({{"action", "keep"},
                       {"object", {{"centre", {1.5 * i, 2.0, 0.5}}, {"class", "car"}}},
                       {"note", "parked for years"}});
    return {{"format", "stillmap-edits"}, {"version", 1}, {"edits", edits}};
  }
  HttpResponse put_edits(const std::string& text, const std::string& if_match = {}) const {
    HttpRequest asked = request("PUT", kEdits);
    asked.headers["content-type"] = "application/json";
    if (!if_match.empty()) asked.headers["if-match"] = if_match;
    asked.body = text;
    return service_->handle(asked);
  }
  static std::string etag(const HttpResponse& response) {
    for (const auto& [name, value] : response.headers)
      if (name == "ETag") return value;
    return "none";
  }
  /// A mapper that keeps the corrections that it was given.
  void start_noting() {
    start_with("if [ -n \"$edits\" ]; then cp $edits " + seen_.string() + "; fi; publish");
  }
  /// What the mapper was given of this rebuild; empty when nothing.
  json given_to(const json& wanted) {
    std::filesystem::remove(seen_);
    job_ = wait_for_end(rebuild(wanted.dump()));
    EXPECT_EQ(job_["status"], "succeeded") << job_.dump();
    std::ifstream file(seen_);
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    return text.empty() ? json() : json::parse(text);
  }

  std::filesystem::path seen_ = scripts_.path() / "seen.json";
  json job_;
};

TEST_F(SavedEditsTest, AreKeptAndReadBack) {
  start();
  const HttpResponse none = get(kEdits);
  EXPECT_EQ(none.status, 200);
  EXPECT_EQ(body(none), document(0));
  const HttpResponse saved = put_edits(document(2).dump());
  ASSERT_EQ(saved.status, 200) << saved.body;
  EXPECT_EQ(body(saved), document(2));
  EXPECT_NE(etag(saved), etag(none));
  const HttpResponse read = get(kEdits);
  EXPECT_EQ(body(read), document(2));
  EXPECT_EQ(etag(read), etag(saved));
  EXPECT_EQ(etag(put_edits(document(2).dump(4))), etag(saved)) << "blanks change nothing";
  HttpRequest again = request("GET", kEdits);
  again.headers["if-none-match"] = etag(saved);
  EXPECT_EQ(service_->handle(again).status, 304);
  EXPECT_EQ(store_.open().edits().of_map("town").text, read.body);
}

TEST_F(SavedEditsTest, OfTwoPeopleAtOnceTheSecondIsTold) {
  start();
  const std::string before = etag(get(kEdits));
  EXPECT_EQ(put_edits(document(1).dump(), before).status, 200);
  const HttpResponse late = put_edits(document(2).dump(), before);
  EXPECT_EQ(late.status, 412);
  EXPECT_EQ(body(late)["code"], "RevisionChanged");
  EXPECT_EQ(body(get(kEdits)), document(1));
  EXPECT_EQ(put_edits(document(2).dump(), etag(get(kEdits))).status, 200);
  EXPECT_EQ(put_edits(document(3).dump(), "*").status, 200);
  EXPECT_EQ(put_edits(document(3).dump(), "nonsense").status, 412);
}

TEST_F(SavedEditsTest, WhatTheMapperWouldNotReadIsRefusedInItsWords) {
  start();
  ASSERT_EQ(put_edits(document(1).dump()).status, 200);
  const auto refused = [&](const std::string& text, int status, const std::string& says) {
    const HttpResponse response = put_edits(text);
    EXPECT_EQ(response.status, status) << text.substr(0, 100);
    EXPECT_THAT(body(response)["detail"].get<std::string>(), HasSubstr(says));
  };
  refused("", 400, "JSON");
  refused("[]", 400, "an object");
  refused(R"({"format": "stillmap-edits", "version": 2, "edits": []})", 400, ".version");
  json wrong = document(2);
  wrong["edits"][1]["action"] = "destroy";
  refused(wrong.dump(), 400, "edits at .edits[1].action");
  wrong = document(1);
  wrong["edits"][0]["object"]["class"] = "tree";
  refused(wrong.dump(), 400, "tree");
  wrong = document(1);
  wrong["edits"][0]["box"] = 7;
  refused(wrong.dump(), 400, "either");
  refused(std::string(100'000, '['), 400, "deep");
  refused("{\"edits\": \"\xff\"}", 400, "JSON");
  json large = document(1);
  large["edits"][0]["note"] = std::string(1 << 20, 'x');
  refused(large.dump(), 413, "at most");
  // 1e9 is written as 1000000000.0.
  std::string long_numbers = R"({"format": "stillmap-edits", "version": 1, "edits": [)";
  while (long_numbers.size() < 1'000'000)
    long_numbers += R"({"action":"keep","object":{"centre":[1e7,1e7,1e7],"class":"car"}},)";
  long_numbers.back() = ']';
  refused(long_numbers + "}", 413, "at most");
  HttpRequest raw = request("PUT", kEdits);
  raw.body = document(0).dump();
  EXPECT_EQ(service_->handle(raw).status, 415);
  EXPECT_EQ(body(get(kEdits)), document(1)) << "what was there stays";
  EXPECT_EQ(body(get("/v1/maps/village/edits"))["code"], "UnknownMap");
}

TEST_F(SavedEditsTest, AreUsedByTheNextRebuildUnlessItBringsItsOwn) {
  start_noting();
  EXPECT_TRUE(given_to({{"drives", {1}}}).is_null());
  EXPECT_EQ(job_["edits"], (json{{"source", "none"}, {"count", 0}}));
  ASSERT_EQ(put_edits(document(2).dump()).status, 200);
  EXPECT_EQ(given_to({{"drives", {1}}}), document(2));
  EXPECT_EQ(job_["edits"], (json{{"source", "saved"}, {"count", 2}}));
  EXPECT_EQ(job_["request"], (json{{"drives", {1}}})) << "as asked";
  EXPECT_EQ(given_to({{"drives", {1}}, {"options", {{"edits", document(1)}}}}), document(1));
  EXPECT_EQ(job_["edits"], (json{{"source", "request"}, {"count", 1}}));
  for (const json& none : {json(), document(0)}) {
    const json given = given_to({{"drives", {1}}, {"options", {{"edits", none}}}});
    EXPECT_TRUE(given.is_null() || given == document(0));
    EXPECT_EQ(job_["edits"]["count"], 0);
  }
}

TEST_F(SavedEditsTest, AreLeftOutWhereTheyCannotBeUsed) {
  start_noting();
  ASSERT_EQ(put_edits(document(2).dump()).status, 200);
  for (const json& wanted : {json{{"drives", {1}}, {"new_frame", true}},
                             json{{"drives", {1}}, {"options", {{"fusion", "off"}}}},
                             json{{"drives", {1}}, {"options", {{"preset", "paper"}}}}}) {
    EXPECT_TRUE(given_to(wanted).is_null()) << wanted.dump();
    EXPECT_EQ(job_["edits"]["source"], "none");
  }
  EXPECT_EQ(given_to({{"drives", {1}}, {"options", {{"preset", "paper"}, {"fusion", "on"}}}}),
            document(2));
}

TEST_F(SavedEditsTest, OfTheMomentOfAskingAreUsedAndTheSameRequestStaysTheSame) {
  start_noting();
  ASSERT_EQ(put_edits(document(1).dump()).status, 200);
  const std::string wanted = R"({"drives": [1]})";
  const json job = body(send("POST", "/v1/maps/town/rebuild", wanted, "once"));
  ASSERT_EQ(put_edits(document(3).dump()).status, 200);
  const json again = body(send("POST", "/v1/maps/town/rebuild", wanted, "once"));
  EXPECT_EQ(again["id"], job["id"]);
  const json done = wait_for_end("/v1/jobs/" + std::to_string(job["id"].get<int>()));
  EXPECT_EQ(done["edits"]["count"], 1);
  std::ifstream file(seen_);
  EXPECT_EQ(json::parse(file), document(1));
}

TEST_F(SavedEditsTest, OfARequestAreReadBeforeAJobIsMade) {
  start_noting();
  json wrong = document(1);
  wrong["edits"][0]["action"] = "destroy";
  const json problem = body(send("POST", "/v1/maps/town/rebuild",
                                 json{{"drives", {1}}, {"options", {{"edits", wrong}}}}.dump()));
  EXPECT_EQ(problem["status"], 400);
  EXPECT_EQ(problem["errors"][0]["path"], "options.edits");
  EXPECT_THAT(problem["detail"].get<std::string>(), HasSubstr("edits[0].action"));
  // Where a job keeps them is no key of a request.
  EXPECT_EQ(body(send("POST", "/v1/maps/town/rebuild",
                      R"({"drives": [1], "edits_from": "saved"})"))["code"],
            "UnknownParameter");
}

/// As a server wrote it that knew of none saved.
TEST(StoredRebuild, OfAnEarlierServerIsRead) {
  EXPECT_EQ(read_stored_rebuild(R"({"drives":[1]})").edits_from, RebuildRequest::EditsFrom::kNone);
  const RebuildRequest with =
      read_stored_rebuild(R"({"drives":[1],"options":{"edits":)" +
                          std::string(R"({"edits":[],"format":"stillmap-edits","version":1}}})"));
  EXPECT_EQ(with.edits_from, RebuildRequest::EditsFrom::kRequest);
  EXPECT_FALSE(with.edits.empty());
}

TEST(StoredRebuild, IsReadAsItWasWritten) {
  for (const char* text : {R"({"drives":[1]})", R"({"drives":[1],"options":{"edits":null}})",
                           R"({"drives":[1],"options":{"clean":"none","voxel":0.2}})"}) {
    RebuildRequest asked = read_rebuild_request(text);
    EXPECT_EQ(nlohmann::json::parse(to_json(asked)), nlohmann::json::parse(text));
    asked.edits_from = RebuildRequest::EditsFrom::kNone;
    const RebuildRequest stored = read_stored_rebuild(to_stored_json(asked));
    EXPECT_EQ(stored.edits_from, asked.edits_from);
    EXPECT_EQ(stored.options, asked.options);
  }
}

}  // namespace edits_test
}  // namespace stillmap::server

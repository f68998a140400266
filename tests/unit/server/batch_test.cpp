#include <gmock/gmock.h>

#include <chrono>
#include <latch>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "service_fixture.hpp"

namespace stillmap::server {
namespace batch_test {

using nlohmann::json;
using ::testing::HasSubstr;

class Batch : public ServiceTest {
 protected:
  void SetUp() override { start(); }

  json ask(const HttpRequest& request, int status = 200) const {
    const HttpResponse response = service_->handle(request);
    EXPECT_EQ(response.status, status) << response.body;
    return body(response);
  }
  static json query_at(double x) {
    return {{"prior", {{"position", {x, 2.0, 3.0}}, {"quaternion", {0.0, 0.0, 0.0, 1.0}}}}};
  }
  static HttpRequest json_batch(const json& content) {
    HttpRequest result = request("POST", "/v1/maps/town/localize/batch");
    result.headers["content-type"] = "application/json";
    result.body = content.dump();
    return result;
  }
  static HttpRequest multipart_batch(
      const json& content, const std::vector<std::pair<std::string, std::string>>& scans) {
    HttpRequest result = request("POST", "/v1/maps/town/localize/batch");
    result.headers["content-type"] = "multipart/form-data; boundary=b";
    const auto add = [&](const std::string& name, const std::string& bytes) {
      result.body +=
          "--b\r\nContent-Disposition: form-data; name=\"" + name + "\"\r\n\r\n" + bytes + "\r\n";
    };
    add("request", content.dump());
    for (const auto& [name, bytes] : scans) add(name, bytes);
    result.body += "--b--\r\n";
    return result;
  }
};

TEST_F(Batch, EndsWhenItsClientHasGone) {
  HttpRequest batch = multipart_batch({{"queries", {query_at(1.0), query_at(2.0), query_at(3.0)}}},
                                      {{"scan-0", raw_scan(60)}, {"scan-1", raw_scan(60)}});
  int aligned = 0;
  aligner_->answer = [&](const auto&) {
    ++aligned;
    return localization::AlignmentResult{};
  };
  batch.client_gone = [&] { return aligned > 0; };
  EXPECT_EQ(ask(batch, 499)["code"], "ClientGone");
  EXPECT_EQ(aligned, 1);
}

TEST_F(Batch, PointsOfOneQueryMayBeUnusable) {
  json queries = {query_at(1.0), query_at(2.0), query_at(3.0)};
  for (int i = 0; i < 60; ++i)
    for (json& query : queries) query["points"].push_back({i % 7, i % 5, i});
  queries[1]["points"][30] = {1, 2, "3"};
  queries[2]["points"] = 5;
  const json answers = ask(json_batch({{"queries", queries}}))["answers"];
  EXPECT_EQ(answers[0]["status"], 200);
  EXPECT_THAT(answers[1]["problem"]["detail"].get<std::string>(), HasSubstr("points[30]"));
  EXPECT_THAT(answers[2]["problem"]["detail"].get<std::string>(), HasSubstr("found 5"));
}

TEST_F(Batch, AnswersInTheOrderOfTheQueries) {
  const json content = {{"queries", {query_at(1.0), query_at(2.0), query_at(3.0)}}};
  // The parts may come in any order.
  const json answer = ask(multipart_batch(
      content, {{"scan-2", raw_scan(60)}, {"scan-0", raw_scan(60)}, {"scan-1", raw_scan(60)}}));
  ASSERT_EQ(answer["answers"].size(), 3U);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(answer["answers"][i]["status"], 200);
    EXPECT_EQ(answer["answers"][i]["answer"]["pose"]["position"][0], i + 1.0);
  }
  EXPECT_EQ(answer["request_id"], "test-1");
}

TEST_F(Batch, TakesScansInsideJson) {
  json query = query_at(5.0);
  query["points"] = json::array();
  for (int i = 0; i < 60; ++i) query["points"].push_back({0.1 * i, 2.0, 3.0});
  const json answer = ask(json_batch({{"queries", {query, query}}, {"deadline_ms", 5000}}));
  ASSERT_EQ(answer["answers"].size(), 2U);
  EXPECT_EQ(answer["answers"][1]["answer"]["status"], "ok");
}

TEST_F(Batch, WhatIsWrongWithOneQueryStaysWithIt) {
  json unknown_key = query_at(1.0);
  unknown_key["colour"] = 1;
  json unknown_method = query_at(1.0);
  unknown_method["method"] = "magic";
  const json content = {
      {"queries", {query_at(1.0), unknown_key, query_at(1.0), unknown_method, query_at(4.0)}}};
  const json answers = ask(multipart_batch(content, {{"scan-0", raw_scan(3)},
                                                     {"scan-1", raw_scan(60)},
                                                     {"scan-3", raw_scan(60)},
                                                     {"scan-4", raw_scan(60)}}))["answers"];
  const std::vector<std::pair<int, std::string>> expected = {{422, "TooFewPoints"},
                                                             {400, "UnknownParameter"},
                                                             {400, "InvalidRequest"},
                                                             {400, "UnknownMethod"}};
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_EQ(answers[i]["status"], expected[i].first);
    EXPECT_EQ(answers[i]["problem"]["code"], expected[i].second);
  }
  EXPECT_EQ(answers[4]["status"], 200);
}

TEST_F(Batch, WhatIsWrongWithTheWholeRefusesIt) {
  const json one = {{"queries", {query_at(1.0)}}};
  const std::string scan = raw_scan(60);
  EXPECT_EQ(ask(multipart_batch(one, {{"scan-1", scan}}), 400)["code"], "UnknownParameter");
  EXPECT_EQ(ask(multipart_batch(one, {{"scan-x", scan}}), 400)["code"], "InvalidRequest");
  EXPECT_EQ(ask(multipart_batch(one, {{"scan-0", scan}, {"scan-0", scan}}), 400)["code"],
            "InvalidRequest");
  EXPECT_EQ(ask(multipart_batch({{"queries", json::array()}}, {}), 400)["code"], "InvalidRequest");
  EXPECT_EQ(ask(json_batch({{"deadline_ms", 1}}), 400)["code"], "InvalidRequest");
  HttpRequest raw = json_batch(one);
  raw.headers["content-type"] = "application/octet-stream";
  EXPECT_EQ(ask(raw, 415)["code"], "UnsupportedMediaType");
}

TEST_F(Batch, IsBoundedInNumber) {
  options_.batch.max_scans = 2;
  start();
  const json three = {{"queries", {query_at(1.0), query_at(2.0), query_at(3.0)}}};
  EXPECT_EQ(ask(json_batch(three), 413)["code"], "PayloadTooLarge");
}

TEST_F(Batch, ItsNumberMayChangeWhileTheServerRuns) {
  options_.batch.max_scans = 2;
  start();
  const json three = {{"queries", {query_at(1.0), query_at(2.0), query_at(3.0)}}};
  const std::string scan = raw_scan(60);
  const HttpRequest parts =
      multipart_batch(three, {{"scan-0", scan}, {"scan-1", scan}, {"scan-2", scan}});
  ask(parts, 400);
  options_.batch.max_scans = 3;
  service_->reload(options_);
  EXPECT_EQ(ask(parts)["answers"].size(), 3U);
  EXPECT_EQ(body(get("/v1/status"))["limits"]["max_batch"], 3);
  // Without points each is refused on its own, and no longer the whole.
  EXPECT_EQ(ask(json_batch(three))["answers"].size(), 3U);
  options_.batch.max_scans = 2;
  service_->reload(options_);
  EXPECT_EQ(ask(json_batch(three), 413)["code"], "PayloadTooLarge");
}

TEST_F(Batch, LongJsonIsReadByAWorker) {
  options_.queue = 1;
  options_.default_deadline_ms = 300;
  start();
  std::latch running(1);
  std::latch release(1);
  aligner_->answer = [&](const auto&) {
    running.count_down();
    release.wait();
    return localization::AlignmentResult{};
  };
  std::thread first([this] { static_cast<void>(service_->handle(good_request())); });
  running.wait();
  const json broken = {{"queries", 1}};
  EXPECT_EQ(ask(multipart_batch(broken, {}), 400)["code"], "InvalidRequest");
  HttpRequest longer = multipart_batch(broken, {});
  longer.body.insert(longer.body.find('{'), std::string(std::size_t{256} << 10U, ' '));
  EXPECT_EQ(ask(longer, 504)["code"], "DeadlineExceeded");
  release.count_down();
  first.join();
  longer.received = std::chrono::steady_clock::now();
  EXPECT_EQ(ask(longer, 400)["code"], "InvalidRequest");
}

TEST_F(Batch, PastItsDeadlineTheRestIsRefused) {
  const auto calm = aligner_->answer;
  aligner_->answer = [&](const auto& prior) {
    std::this_thread::sleep_for(std::chrono::milliseconds(60));
    return calm(prior);
  };
  const json content = {{"queries", {query_at(1.0), query_at(2.0)}}, {"deadline_ms", 50}};
  const json answers = ask(
      multipart_batch(content, {{"scan-0", raw_scan(60)}, {"scan-1", raw_scan(60)}}))["answers"];
  EXPECT_EQ(answers[0]["status"], 200);
  EXPECT_EQ(answers[1]["problem"]["code"], "DeadlineExceeded");
}

}  // namespace batch_test
}  // namespace stillmap::server

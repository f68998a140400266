#include <gmock/gmock.h>

#include "job_fixture.hpp"

namespace stillmap::server {
namespace job_requests_test {

using ::testing::HasSubstr;

class JobRequests : public JobTest {
 protected:
  nlohmann::json refused(const std::string& json) const {
    return body(send("POST", "/v1/maps/town/rebuild", json));
  }
  std::string make_admin_key() const {
    return store_.open().keys().create("admin", {8}, {}, unix_ns()).text;
  }
};

TEST_F(JobRequests, BadOnesAreRefusedByField) {
  start_with("publish");
  const std::vector<std::pair<std::string, std::string>> cases = {
      {R"({})", "drives"},
      {R"({"drives": []})", "drives"},
      {R"({"drives": ["1"]})", "drives[0]"},
      {R"({"drives": [1, 1]})", "drives[1]"},
      {R"({"drives": [1], "held_back": 1})", "held_back"},
      {R"({"drives": [1], "patch": true, "new_frame": true})", "patch"},
      {R"({"drives": [1], "patch": 1})", "patch"},
      {R"({"drives": [1], "version": "../x"})", "version"},
      {R"({"drives": [1], "activate": 1})", "activate"},
      {R"({"drives": [1], "options": {"detector": "onnx:/etc/passwd"}})", "options.detector"},
      {R"({"drives": [1], "options": {"movable": ""}})", "options.movable"},
      {R"({"drives": [1], "options": {"voxel": 0.001}})", "options.voxel"},
      {R"({"drives": [1], "options": {"pose-time-offset": "auto"}})", "options.pose-time-offset"},
      {R"({"drives": [1], "options": {"edits": "/etc/passwd"}})", "options.edits"},
      {R"({"drives": [1], "options": {"poses": "/etc/passwd"}})", "options.poses"},
      {R"({"drives": [1], "work": "/tmp"})", "work"}};
  for (const auto& [json, path] : cases) {
    const nlohmann::json problem = refused(json);
    EXPECT_EQ(problem["status"], 400) << json;
    EXPECT_EQ(problem["errors"][0]["path"], path) << json;
  }
  EXPECT_EQ(refused("no json")["code"], "InvalidRequest");
  EXPECT_EQ(body(get("/v1/jobs"))["jobs"].size(), 0U);
}

TEST_F(JobRequests, DrivesMustBeCompleteAndOfTheMap) {
  start_with("publish");
  store_.open().create_map("village");
  send("POST", "/v1/maps/town/drives");
  EXPECT_EQ(refused(R"({"drives": [2]})")["code"], "DriveNotComplete");
  EXPECT_EQ(refused(R"({"drives": [3]})")["code"], "UnknownDrive");
  EXPECT_EQ(body(send("POST", "/v1/maps/village/rebuild", R"({"drives": [1]})"))["code"],
            "UnknownDrive");
  EXPECT_EQ(body(send("POST", "/v1/maps/hamlet/rebuild", R"({"drives": [1]})"))["code"],
            "UnknownMap");
  EXPECT_EQ(refused(R"({"drives": [1], "version": "v1"})")["code"], "OtherDigest");
}

TEST_F(JobRequests, VersionThatCannotBecomeItsOwnIsRefusedAtOnce) {
  start_with("say 0.1 first; while [ ! -e $0.go ]; do sleep 0.05; done; publish");
  test::write_package(scripts_.path() / "other", 8);
  store_.open().add("town", "gone", scripts_.path() / "other");
  store_.open().remove("town", "gone");
  const nlohmann::json removed = refused(R"({"drives": [1], "version": "gone"})");
  EXPECT_EQ(removed["status"], 409);
  EXPECT_EQ(removed["code"], "OtherDigest");
  EXPECT_THAT(removed["detail"].get<std::string>(), HasSubstr("was removed"));
  const std::string json = R"({"drives": [1], "version": "v2"})";
  EXPECT_EQ(send("POST", "/v1/maps/town/rebuild", json, "once").status, 202);
  const nlohmann::json twice = refused(R"({"drives": [1], "version": "v2", "activate": true})");
  EXPECT_EQ(twice["code"], "OtherDigest");
  EXPECT_THAT(twice["detail"].get<std::string>(), HasSubstr("job 1"));
  EXPECT_EQ(body(send("POST", "/v1/maps/town/rebuild", json, "once"))["id"], 1);
  std::ofstream(mapper_.string() + ".go") << "x";
  EXPECT_EQ(wait_for_end("/v1/jobs/1")["status"], "succeeded");
}

TEST_F(JobRequests, WhatTheDiskOrTheQuotaLacksIsRefusedBeforeItStarts) {
  start_with("publish", "1000000000000000000");
  EXPECT_EQ(refused(R"({"drives": [1]})")["code"], "DiskFull");
  EXPECT_EQ(refused(R"({"drives": [1]})")["status"], 507);
  store_.open().set_quota({.map_bytes = 5000});
  EXPECT_EQ(refused(R"({"drives": [1]})")["code"], "OverQuota");
  EXPECT_EQ(body(get("/v1/jobs"))["jobs"].size(), 0U);
}

TEST_F(JobRequests, WithoutAMapperTheAnswerSaysSo) {
  start();
  make_drive();
  EXPECT_EQ(refused(R"({"drives": [1]})")["code"], "NoMapper");
}

TEST_F(JobRequests, SameIdempotencyKeyIsTheSameJob) {
  start_with("publish");
  const std::string json = R"({"drives": [1]})";
  EXPECT_EQ(body(send("POST", "/v1/maps/town/rebuild", json, "once"))["id"], 1);
  wait_for_end("/v1/jobs/1");
  EXPECT_EQ(body(send("POST", "/v1/maps/town/rebuild", json, "once"))["id"], 1);
  EXPECT_EQ(body(send("POST", "/v1/maps/town/rebuild", json, "twice"))["id"], 2);
  EXPECT_EQ(body(send("POST", "/v1/maps/town/rebuild", R"({"drives": [1], "activate": true})",
                      "once"))["code"],
            "OtherRequest");
  EXPECT_EQ(send("POST", "/v1/maps/town/rebuild", json, std::string(129, 'a')).status, 400);
}

/// A file with a good header; the script that stands for the mapper reads neither.
TEST_F(JobRequests, WhatCannotBeACloudIsRefusedBeforeItIsAJob) {
  start_with("publish");
  const std::string path = "/v1/maps/town/versions/v2";
  const HttpResponse refused = put(path, "no cloud at all", "application/vnd.pcd");
  EXPECT_EQ(refused.status, 422);
  EXPECT_EQ(body(refused)["code"], "InvalidUpload");
  EXPECT_THAT(body(refused)["detail"].get<std::string>(), HasSubstr("town/v2"));
  EXPECT_EQ(put(path, pcd(""), "application/ply").status, 422);
  EXPECT_EQ(put(path, "", "application/ply").status, 422);
  EXPECT_EQ(body(get("/v1/jobs"))["jobs"].size(), 0U);
  // A header and more than fits into what is looked at.
  const HttpResponse large = put(path, pcd(std::string(200'000, 'x')), "application/vnd.pcd");
  ASSERT_EQ(large.status, 202) << large.body;
  const std::string sha256 = body(large)["request"]["sha256"];
  EXPECT_EQ(sha256, maps::sha256_of(pcd(std::string(200'000, 'x'))));
}

TEST_F(JobRequests, CloudFromElsewhereIsConvertedOnce) {
  start_with("publish");
  const std::string path = "/v1/maps/town/versions/v2";
  const HttpResponse accepted = put(path, pcd("cloud"), "application/vnd.pcd");
  ASSERT_EQ(accepted.status, 202) << accepted.body;
  EXPECT_EQ(body(accepted)["kind"], "convert");
  const nlohmann::json job = wait_for_end("/v1/jobs/1");
  EXPECT_EQ(job["status"], "succeeded") << job.dump();
  EXPECT_TRUE(job["result"]["gate"].is_null());
  EXPECT_EQ(body(put(path, pcd("cloud"), "application/vnd.pcd"))["version"], "v2");
  // Nobody will read what came in vain.
  const auto uploads = store_.folder().path() / "jobs" / "uploads";
  EXPECT_TRUE(std::filesystem::is_empty(uploads));
  EXPECT_EQ(put(path, pcd("cloud"), "application/vnd.pcd").status, 200);
  EXPECT_EQ(body(put(path, pcd("other"), "application/vnd.pcd"))["code"], "OtherDigest");
  EXPECT_TRUE(std::filesystem::is_empty(uploads));
  EXPECT_EQ(put("/v1/maps/new/versions/v1", kPly, "application/ply").status, 202);
  EXPECT_EQ(wait_for_end("/v1/jobs/2")["status"], "succeeded");
  EXPECT_TRUE(store_.open().state().find_version("new", "v1").has_value());
}

TEST_F(JobRequests, CloudsThatWaitForTheirConversionCountTowardsTheQuotas) {
  start_with("while [ ! -e $0.go ]; do sleep 0.05; done; publish");
  const std::uint64_t used = store_.open().state().bytes_of_map("town");
  store_.open().set_quota({.map_bytes = used + 5000});
  const auto cloud = [](char fill) { return pcd(std::string(3000, fill)); };
  const std::string type = "application/vnd.pcd";
  EXPECT_EQ(put("/v1/maps/town/versions/v2", cloud('a'), type).status, 202);
  EXPECT_EQ(put("/v1/maps/town/versions/v2", cloud('a'), type).status, 202) << "the same again";
  const HttpResponse refused = put("/v1/maps/town/versions/v3", cloud('b'), type);
  EXPECT_EQ(body(refused)["code"], "OverQuota") << refused.body;
  EXPECT_EQ(put("/v1/maps/other/versions/v1", cloud('b'), type).status, 202) << "its own quota";
  store_.open().set_quota({.store_bytes = store_.open().state().bytes() + 8000});
  EXPECT_EQ(body(put("/v1/maps/town/versions/v3", cloud('c'), type))["code"], "OverQuota");
  send("POST", "/v1/jobs/1/cancel");
  wait_for_end("/v1/jobs/1");
  EXPECT_EQ(put("/v1/maps/town/versions/v3", cloud('c'), type).status, 202);
}

TEST_F(JobRequests, WritesAreAuditedAndReadsAreNot) {
  start_with("publish");
  wait_for_end(rebuild());
  refused("{}");
  get("/v1/maps");
  const nlohmann::json records = body(get("/v1/audit"))["records"];
  ASSERT_GE(records.size(), 5U);
  EXPECT_EQ(records[0]["route"], "/v1/maps/{map}/rebuild");
  EXPECT_EQ(records[0]["subject"], "town");
  EXPECT_EQ(records[0]["status"], 400);
  EXPECT_EQ(records[1]["status"], 202);
  EXPECT_EQ(records[2]["subject"], "town/1");
  EXPECT_EQ(records[3]["subject"], "town/1/1");
  for (const nlohmann::json& record : records) EXPECT_NE(record["method"], "GET");
}

TEST_F(JobRequests, KeysAreMadeShownOnceAndRevoked) {
  start();
  HttpRequest asked = request("POST", "/v1/keys");
  asked.headers["authorization"] = "Bearer " + make_admin_key();
  asked.headers["content-type"] = "application/json";
  asked.body = R"({"name": "boss", "scopes": ["admin"], "expires_days": 1})";
  const HttpResponse made = service_->handle(asked);
  ASSERT_EQ(made.status, 201);
  const std::string id = body(made)["id"];
  HttpRequest list = request("GET", "/v1/keys");
  EXPECT_EQ(service_->handle(list).status, 401);
  list.headers["authorization"] = "Bearer " + body(made)["key"].get<std::string>();
  const nlohmann::json keys = body(service_->handle(list))["keys"];
  ASSERT_EQ(keys.size(), 2U);
  for (const nlohmann::json& key : keys) EXPECT_FALSE(key.contains("key"));
  EXPECT_TRUE(keys[0]["name"] == "boss" || keys[1]["name"] == "boss");
  HttpRequest revoke = list;
  revoke.method = "DELETE";
  revoke.path = "/v1/keys/nobody";
  EXPECT_EQ(body(service_->handle(revoke))["code"], "UnknownKey");
  revoke.path = "/v1/keys/" + id;
  EXPECT_EQ(service_->handle(revoke).status, 200);
  EXPECT_EQ(service_->handle(list).status, 401);
}

TEST_F(JobRequests, BadKeysAreRefusedByField) {
  start();
  const std::string key = make_admin_key();
  for (const auto& [json, path] : std::vector<std::pair<std::string, std::string>>{
           {R"({"scopes": ["read"]})", "name"},
           {R"({"name": "a", "scopes": []})", "scopes"},
           {R"({"name": "a", "scopes": ["root"]})", "scopes"},
           {R"({"name": "a", "scopes": ["read"], "expires_days": 0})", "expires_days"}}) {
    HttpRequest asked = request("POST", "/v1/keys");
    asked.headers["authorization"] = "Bearer " + key;
    asked.headers["content-type"] = "application/json";
    asked.body = json;
    EXPECT_EQ(body(service_->handle(asked))["errors"][0]["path"], path);
  }
}

}  // namespace job_requests_test
}  // namespace stillmap::server

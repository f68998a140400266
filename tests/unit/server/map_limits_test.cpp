#include "security/map_limits.hpp"

#include <gmock/gmock.h>

#include <set>

#include "job_fixture.hpp"

namespace stillmap::server {
namespace map_limits_test {

using ::testing::HasSubstr;
using ::testing::Not;

/// A town with a drive, an upload, a job, an open session and a set, and a key for other maps.
class MapLimits : public JobTest {
 protected:
  void SetUp() override {
    start_with("publish");
    upload_ = body(send("POST", "/v1/maps/town/uploads",
                        R"({"version": "v9", "content_type": "application/gzip"})"))["id"];
    job_ = rebuild();
    wait_for_end(job_);
    key_ = make_key({"village*", "hamlet"});
    send("PUT", "/v1/sets/ring", R"({"maps": [{"map": "town"}]})");
    const std::string vehicle = make_key({});
    HttpRequest opening = with(vehicle, request("POST", "/v1/sessions"));
    opening.headers["content-type"] = "application/json";
    opening.body = R"({"map": "town"})";
    session_ = body(service_->handle(opening))["id"];
  }
  /// All that a key with patterns can do.
  [[nodiscard]] std::string make_key(const std::vector<std::string>& maps) const {
    return store_.open().keys().create("key", {7}, {}, unix_ns(), maps).text;
  }
  static HttpRequest with(const std::string& key, HttpRequest request) {
    request.headers["authorization"] = "Bearer " + key;
    return request;
  }
  /// A request that fits the route, about what there is of a map.
  [[nodiscard]] HttpRequest request_to(const Route& route, const std::string& map) const {
    std::string path = route.pattern;
    const std::map<std::string, std::string> values = {{"{map}", map},
                                                       {"{version}", "v1"},
                                                       {"{other}", "v1"},
                                                       {"{drive}", "1"},
                                                       {"{part}", "1"},
                                                       {"{upload}", std::to_string(upload_)},
                                                       {"{job}", job_.substr(9)},
                                                       {"{session}", session_},
                                                       {"{set}", "ring"}};
    for (const auto& [name, value] : values)
      if (const std::size_t at = path.find(name); at != std::string::npos)
        path.replace(at, name.size(), value);
    for (std::size_t at = 0; (at = path.find('{')) != std::string::npos;)
      path.replace(at, path.find('}') - at + 1, "0");
    HttpRequest result = request(route.method, path);
    if (path.starts_with("/v1/localize")) result.query.emplace_back("set", "ring");
    if (route.body == BodyKind::kWhole) {
      result.headers["content-type"] = "application/json";
      result.body = R"({"map": ")" + map + R"("})";
    }
    return result;
  }
  [[nodiscard]] HttpResponse ask(const std::string& key, const std::string& path) const {
    return service_->handle(with(key, request("GET", path)));
  }

  int upload_ = 0;
  std::string job_, session_, key_;
};

TEST_F(MapLimits, AKeyForOtherMapsGetsNothingOfATown) {
  const std::set<std::string> lists = {"/v1/maps", "/v1/jobs", "/v1/sessions", "/v1/status",
                                       "/v1/sets"};
  int refused = 0;
  for (const Route* route : service_->routes()) {
    if (is_open(route->access)) continue;
    const std::string what = route->method + " " + route->pattern;
    const HttpResponse response = service_->handle(with(key_, request_to(*route, "town")));
    if (route->method == "GET" && lists.contains(route->pattern)) {
      EXPECT_EQ(response.status, 200) << what;
      EXPECT_THAT(response.body, Not(HasSubstr("town"))) << what;
      continue;
    }
    EXPECT_TRUE(response.status == 403 || response.status == 404) << what << response.status;
    EXPECT_THAT(response.body, Not(HasSubstr("v1\""))) << what;
    ++refused;
    if (route->pattern.find("{map}") == std::string::npos) continue;
    // What is not there is refused in the same words.
    HttpResponse nowhere = service_->handle(with(key_, request_to(*route, "zzzz")));
    for (std::size_t at = 0; (at = nowhere.body.find("zzzz")) != std::string::npos;)
      nowhere.body.replace(at, 4, "town");
    EXPECT_EQ(response.status, 403) << what;
    EXPECT_EQ(nowhere.body, response.body) << what;
  }
  EXPECT_GT(refused, 40);
}

TEST_F(MapLimits, AKeyForTheTownGetsWhatItsScopesAllow) {
  const std::string key = make_key({"village", "to*n"});
  EXPECT_EQ(ask(key, "/v1/maps/town").status, 200);
  EXPECT_EQ(ask(key, job_).status, 200);
  EXPECT_EQ(ask(key, "/v1/maps/town/drives/1").status, 200);
  EXPECT_EQ(body(ask(key, "/v1/maps"))["maps"].size(), 1U);
  EXPECT_EQ(body(ask(key, "/v1/jobs"))["jobs"].size(), 1U);
  EXPECT_EQ(body(ask(key, "/v1/status"))["maps"], 1);
  EXPECT_EQ(body(ask(key_, "/v1/maps"))["maps"].size(), 0U);
  EXPECT_EQ(body(ask(key_, "/v1/jobs"))["jobs"].size(), 0U);
  EXPECT_EQ(body(ask(key_, "/v1/status"))["maps"], 0);
  HttpRequest opening = with(key, request("POST", "/v1/sessions"));
  opening.headers["content-type"] = "application/json";
  opening.body = R"({"map": "town"})";
  EXPECT_EQ(service_->handle(opening).status, 201);
  EXPECT_EQ(service_->handle(with(key_, request("PUT", "/v1/maps/village-7"))).status, 201);
  EXPECT_EQ(service_->handle(with(key_, request("PUT", "/v1/maps/hamlets"))).status, 403);
}

TEST_F(MapLimits, JobsOfOtherMapsAreAsIfTheyWereNotThere) {
  const nlohmann::json other = body(ask(key_, job_));
  const nlohmann::json none = body(ask(key_, "/v1/jobs/77"));
  EXPECT_EQ(other["code"], "UnknownJob");
  EXPECT_EQ(other["detail"], "there is no job " + job_.substr(9));
  EXPECT_EQ(none["code"], "UnknownJob");
  EXPECT_EQ(none["detail"], "there is no job 77");
  HttpRequest of_town = with(key_, request("GET", "/v1/jobs"));
  of_town.query = {{"map", "town"}};
  EXPECT_EQ(service_->handle(of_town).status, 403);
}

TEST_F(MapLimits, KeysAreMadeForMapsOverHttpButNoneThatMakesKeys) {
  const std::string admin = store_.open().keys().create("admin", {8}, {}, unix_ns()).text;
  const auto make = [&](const std::string& json) {
    HttpRequest asked = with(admin, request("POST", "/v1/keys"));
    asked.headers["content-type"] = "application/json";
    asked.body = json;
    return service_->handle(asked);
  };
  const HttpResponse made = make(R"({"name": "a", "scopes": ["read"], "maps": ["town-*", "b"]})");
  ASSERT_EQ(made.status, 201) << made.body;
  EXPECT_EQ(body(made)["maps"], nlohmann::json({"town-*", "b"}));
  EXPECT_TRUE(body(make(R"({"name": "a", "scopes": ["read"]})"))["maps"].is_null());
  EXPECT_EQ(ask(body(made)["key"], "/v1/maps/town").status, 403);
  for (const char* maps : {"[]", "[1]", "[\"\"]", "[\"Town\"]", "[\"a?\"]", "\"a\"", "[\"[a]\"]"}) {
    const HttpResponse refused =
        make(R"({"name": "a", "scopes": ["read"], "maps": )" + std::string(maps) + "}");
    EXPECT_EQ(refused.status, 400) << maps;
    EXPECT_EQ(body(refused)["errors"][0]["path"], "maps");
  }
  const HttpResponse refused =
      make(R"({"name": "a", "scopes": ["read", "admin"], "maps": ["town"]})");
  EXPECT_EQ(refused.status, 400);
  EXPECT_THAT(refused.body, HasSubstr("leave one of them out"));
}

}  // namespace map_limits_test
}  // namespace stillmap::server
